"""Verbs that use an identification to say what is to come: predict, draws."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from butterfly.api.drawn import Drawn
from butterfly.api.predicted import Predicted
from butterfly.api.saved import load
from butterfly.api.sources import Data, Named, is_data, read
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.experiment.schema import Experiment
from butterfly.experiment.simulate import planned_logs
from butterfly.experiment.source import read_experiment
from butterfly.files import locate
from butterfly.identification.data import DataSet
from butterfly.identification.draws import COUNT, ParameterDraws, draw_parameters, weighed
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import Setting
from butterfly.identification.identification import Identification
from butterfly.identification.parameters_by_hand import given_estimate, judged_on, outdone
from butterfly.identification.predict import ExpectedErrors, expected_errors, predict_logs
from butterfly.logs.log import InputKind, Log
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.prior import Known
from butterfly.progress import Track, untracked
from butterfly.report.finding_texts import require_possible


def predict(
    data: Data | Experiment,
    result: Identification | Named | LumpedParameters | Mapping[str, object],
    *,
    bands: bool | None = None,
    draws: int = COUNT,
    seed: int = 0,
    track: Track = untracked,
) -> Predicted:
    """Predict logs, or an experiment that nobody has done, with given parameters.

    Nothing is identified: the verdict says whether these parameters move like this robot.

    Parameters
    ----------
    data
        What `read` takes or has read; or an experiment: its file, its name, or what
        `read_experiment` returned, of which the inputs count.
    result
        An identification, or the file where it was saved; or parameters, such as
        ``{"p1": 0.18, "p3": 3.7, "p4": 1.0}``: what is not given is 0, but for p4, of which the
        best one is taken, and ``zero``, the encoder's reading in rad of the hanging joint, which is
        taken from the logs.
    bands
        Whether to say how far the prediction is known; if not given, of every identification.
    draws
        How many sets of parameters the bands are made of.
    seed
        Fixes everything random.
    track
        Shows progress.

    Raises
    ------
    InputError
        If data, experiment or result are none, or of other inputs than each other.
    IdentifiabilityError
        If the estimate has no covariance, which bands need.
    UnusableError
        If no joint has the parameters of the estimate.
    """
    source = _source(data)
    logs: Sequence[Log]
    if isinstance(source, Experiment):
        logs, whole = planned_logs(source), None
        setting = _from_rest(logs)
    else:
        whole = source.whole
        logs, setting = whole.logs, whole.simulations.setting
    masses = sorted({log.added_mass for log in logs})
    if isinstance(result, LumpedParameters | Mapping):
        told = result if isinstance(result, Mapping) else asdict(result)
        estimate = given_estimate(told, "predict", data=whole, masses=masses)
        require_possible(estimate)
        if whole is not None and None in estimate.local:
            whole = whole.with_zero(Known(value=estimate.local[None]["zero"]))
            logs, setting = whole.logs, whole.simulations.setting
        if bands:
            raise IdentifiabilityError("bands need an identification: parameters alone have none")
        known = _Known(said=_of_gain(told, estimate, whole))
    else:
        found = _identified(result)
        _require_input(found, source.input_kind)
        estimate = found.estimate
        known = _Known() if bands is False else _Known.of(found, logs, draws, seed, track)
    predictions = predict_logs(
        logs,
        estimate,
        setting,
        draws=known.draws,
        errors=known.errors,
        seed=seed,
        track=track,
    )
    drawn = None if known.draws is None else Drawn.of(known.draws, found, known.said)
    if whole is not None:
        counted = whole.counted
        fits = np.array([predictions[k].run.fit for k in counted])
        estimate = judged_on(estimate, fits, [logs[k].name for k in counted])
        estimate = estimate.with_findings(*outdone(whole, estimate, fits, counted))
    return Predicted.of(
        source.name, predictions, known.said, estimate, drawn=drawn, measured=whole is not None
    )


def draws(
    result: Identification | Named, n: int = COUNT, seed: int = 0, *, track: Track = untracked
) -> Drawn:
    """Draw parameters that an identification leaves open, as for domain randomisation.

    Parameters
    ----------
    result
        An identification, or the file where it was saved.
    n
        How many.
    seed
        Fixes the draws.
    track
        Shows progress.

    Raises
    ------
    InputError
        If it is none, or ``n`` is too small.
    IdentifiabilityError
        If the estimate has no covariance.
    UnusableError
        If no joint has its parameters.
    """
    found = _identified(result)
    known = _Known.of(found, (), n, seed, track)
    assert known.draws is not None  # noqa: S101 - or there was an error
    return Drawn.of(known.draws, found, known.said[:1])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Known:
    """What an identification leaves open.

    Parameters
    ----------
    draws
        Of its parameters; None if there is to be no band.
    errors
        Of the logs that it was made from; none if they are not at hand.
    said
        How these were made, in plain words; on the draws first.
    """

    draws: ParameterDraws | None = None
    errors: Sequence[ExpectedErrors] = ()
    said: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, found: Identification, logs: Iterable[Log], count: int, seed: int, track: Track
    ) -> _Known:
        """Draw parameters with which all logs have a joint; weigh them if the data are at hand."""
        logs = list(logs)
        masses = [log.added_mass for log in logs]
        try:
            data = found.data
        except InputError as error:
            draws = draw_parameters(found.estimate, count, masses=masses, seed=seed)
            said = (
                f"{count} draws of the parameters, not weighed: the logs that the estimate was "
                f"made from cannot be read ({error}).",
                "For the same reason there is no band of a new log, which needs their errors.",
            )
            return cls(draws=draws, said=said)
        masses += data.masses
        draws = draw_parameters(found.estimate, count, masses=masses, seed=seed)
        draws = weighed(draws, data, bands=logs, track=track)
        errors = expected_errors(data, found.estimate)
        more = (*_of_errors(errors), *_beyond(data.masses, logs))
        return cls(draws=draws, errors=errors, said=(_of_draws(draws), *more))


def _of_gain(
    told: Mapping[str, object], estimate: Estimate, data: DataSet | None
) -> tuple[str, ...]:
    """Say which p4 was taken where none was given."""
    known = {} if data is None else data.known.fixed
    gain = (known | dict(told)).get("p4", math.nan)
    if isinstance(gain, float) and math.isnan(gain):
        return (f"p4 was not given: {estimate.parameters.p4:.4g} has the best FIT.",)
    return ()


def _of_draws(draws: ParameterDraws) -> str:
    count = len(draws.values)
    return (
        f"{count} draws of the parameters, which count as {draws.effective_size:.0f}: those that "
        "follow the logs worse than a linear model promises count less."
    )


def _of_errors(errors: Sequence[ExpectedErrors]) -> list[str]:
    unseen = sum(each.unseen for each in errors)
    if unseen == len(errors):
        return [
            f"The band of a new log has the errors of {unseen} logs, each simulated without having "
            "seen its added mass."
        ]
    return [
        f"The band of a new log has the errors of {len(errors)} logs, of which "
        f"{len(errors) - unseen} were seen with their added mass: no fit without it is known. It "
        "may be too narrow for another mass."
    ]


def _beyond(seen: Sequence[AddedMass], logs: Iterable[Log]) -> list[str]:
    """Say which added masses lie beyond all that the estimate was made from."""
    least, largest = (limit(seen, key=lambda mass: mass.inertia) for limit in (min, max))
    beyond = {
        str(log.added_mass)
        for log in logs
        if not least.inertia <= log.added_mass.inertia <= largest.inertia
    }
    if not beyond:
        return []
    return [
        f"{', '.join(sorted(beyond))}: beyond the added masses of the estimate ({least} to "
        f"{largest}), where it could not be checked."
    ]


def _identified(result: Identification | Named) -> Identification:
    found = load(result) if isinstance(result, str | PathLike) else result
    if not isinstance(found, Identification):
        expected = "an identification, or the file where it was saved"
        raise InputError("predict", "result", type(found).__name__, expected)
    require_possible(found.estimate)
    return found


def _source(data: Any) -> DataSet | Experiment:  # noqa: ANN401 - whatever was given
    if isinstance(data, Experiment):
        return data
    if isinstance(data, str | PathLike) and str(data) and not is_data(locate(Path(data))):
        return read_experiment(data)
    return read(data)


def _require_input(found: Identification, kind: InputKind) -> None:
    own = found.origin["input"]
    if kind != own:
        raise InputError("predict", "input", str(kind), f"{own}, as the estimate was made with")


def _from_rest(logs: Sequence[Log]) -> Callable[[int, Estimate], Setting]:
    """Return what simulates a log from rest, its angles from where the hand hangs."""
    return lambda number, estimate: Setting(parameters=estimate.applied(logs[number])[0], zero=0.0)
