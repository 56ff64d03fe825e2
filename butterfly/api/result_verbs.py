"""Verbs that take an identification: predict, draws, changed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from butterfly.api.changed import Changed
from butterfly.api.predicted import Drawn, Predicted
from butterfly.api.saved import load
from butterfly.api.sources import Data, Named, is_data, read
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.experiment.schema import Experiment
from butterfly.experiment.simulate import planned_logs
from butterfly.experiment.source import read_experiment
from butterfly.files import locate
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.plausibility import judge_fit
from butterfly.identification.draws import COUNT, ParameterDraws, draw_parameters, weighed
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import Setting
from butterfly.identification.identification import Identification
from butterfly.identification.parameters_by_hand import given_estimate
from butterfly.identification.predict import ExpectedErrors, expected_errors, predict_logs
from butterfly.logs.log import InputKind, Log
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.prior import Known
from butterfly.progress import Track, untracked
from butterfly.report.finding_texts import require_possible

_NO_ERRORS = "For the same reason there is no band of a new log, which needs their errors."


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
    errors: Sequence[ExpectedErrors] = ()
    sentences: tuple[str, ...] = ()
    open_draws: ParameterDraws | None = None
    drawn: Drawn | None = None
    if isinstance(source, Experiment):
        logs, whole = planned_logs(source), None

        def setting(number: int, estimate: Estimate) -> Setting:
            """Begin at rest, angles counted from where the hand hangs."""
            return Setting(parameters=estimate.applied(logs[number])[0], zero=0.0)

    else:
        whole = source.whole
        logs, setting = whole.logs, whole.simulations.setting
    masses = sorted({log.added_mass for log in logs})
    if isinstance(result, LumpedParameters | Mapping):
        given = result if isinstance(result, Mapping) else asdict(result)
        estimate = given_estimate(given, "predict", data=whole, masses=masses)
        require_possible(estimate)
        if whole is not None and None in estimate.local:
            whole = whole.with_zero(Known(value=estimate.local[None]["zero"]))
            logs, setting = whole.logs, whole.simulations.setting
        if bands:
            raise IdentifiabilityError("bands need an identification: parameters alone have none")
        sentences = _of_gain(given, estimate, whole)
    else:
        found = _identified(result)
        require_possible(found.estimate)
        own = found.origin["input"]
        if source.input_kind not in {own, InputKind.NONE}:
            expected = f"{own}, as the estimate was made with"
            raise InputError("predict", "input", str(source.input_kind), expected)
        estimate = found.estimate
        if bands is not False:
            open_draws, seen, sentence = _left_open(found, logs, draws, seed, track)
            if seen is None:
                sentences = (sentence, _NO_ERRORS)
            else:
                errors = expected_errors(seen, estimate)
                sentences = (sentence, _of_errors(errors), *_beyond(seen.masses, logs))
            drawn = Drawn.of(open_draws.resampled(draws, seed), found, sentences)
    predictions = predict_logs(
        logs, estimate, setting, draws=open_draws, errors=errors, seed=seed, track=track
    )
    if whole is not None:
        fits = np.array([predictions[k].run.followed for k in whole.counted])
        estimate = estimate.with_findings(*judge_fit(fits))
    return Predicted.of(
        source.name, predictions, sentences, estimate, drawn=drawn, measured=whole is not None
    )


def draws(
    result: Identification | Named, n: int = COUNT, seed: int = 0, *, track: Track = untracked
) -> Drawn:
    """Draw parameters that an identification leaves open, as for domain randomisation.

    Each draw is simulated on the logs, and counts by how well it follows them; so many that count
    alike are then chosen of them.

    Parameters
    ----------
    result
        An identification, or the file where it was saved.
    n
        How many, 1 or more.
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
    require_possible(found.estimate)
    if n < 1:
        raise InputError("draws", "count", n, "1 or more")
    drawn, _, sentence = _left_open(found, (), max(n, COUNT), seed, track)
    return Drawn.of(drawn.resampled(n, seed), found, (sentence,))


def changed(before: Identification | Named, after: Identification | Named) -> Changed:
    """Tell whether a robot has changed between two identifications from independent logs.

    Parameters
    ----------
    before, after
        Identifications, or the files where they were saved.

    Raises
    ------
    InputError
        If one is none, their inputs are of different kinds, or they have no parameter in common of
        which both know an error.
    """
    one, other = (_identified(each, "changed") for each in (before, after))
    return Changed.of(one, other)


def _left_open(
    found: Identification, logs: Sequence[Log], count: int, seed: int, track: Track
) -> tuple[ParameterDraws, DataSet | None, str]:
    """Return draws with which all logs have a joint, the data that weighed them, and how."""
    masses = [log.added_mass for log in logs]
    try:
        data = found.data
    except InputError as error:
        drawn = draw_parameters(found.estimate, count, masses=masses, seed=seed)
        sentence = (
            f"{count} sets of parameters were drawn, and not compared with the logs, which cannot "
            f"be read ({error})."
        )
        return drawn, None, sentence
    drawn = draw_parameters(found.estimate, count, masses=[*masses, *data.masses], seed=seed)
    drawn = weighed(drawn, data, bands=logs, track=track)
    sentence = (
        f"{len(drawn.values)} parameter draws (effective sample size {drawn.effective_size:.0f}): "
        "draws that follow the logs worse than the linearised model predicts count less."
    )
    return drawn, data, sentence


def _of_gain(
    given: Mapping[str, object], estimate: Estimate, data: DataSet | None
) -> tuple[str, ...]:
    """Say which p4 was taken where none was given."""
    known = {} if data is None else data.known.fixed
    gain = (known | dict(given)).get("p4", math.nan)
    if isinstance(gain, float) and math.isnan(gain):
        return (f"p4 was not given: {estimate.parameters.p4:.4g} has the best FIT.",)
    return ()


def _of_errors(errors: Sequence[ExpectedErrors]) -> str:
    unseen = sum(each.unseen for each in errors)
    if unseen == len(errors):
        return (
            f"The band of a new log has the errors of {unseen} logs, each simulated without having "
            "seen its added mass."
        )
    return (
        f"The band of a new log has the errors of {len(errors)} logs, of which "
        f"{len(errors) - unseen} were seen with their added mass: no fit without it is known. It "
        "may be too narrow for another mass."
    )


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


def _identified(result: Identification | Named, verb: str = "predict") -> Identification:
    found = load(result) if isinstance(result, str | PathLike) else result
    if not isinstance(found, Identification):
        expected = "an identification, or the file where it was saved"
        raise InputError(verb, "result", type(found).__name__, expected)
    return found


def _source(data: Any) -> DataSet | Experiment:  # noqa: ANN401 - whatever was given
    if isinstance(data, Experiment):
        return data
    if isinstance(data, str | PathLike) and str(data) and not is_data(locate(Path(data))):
        return read_experiment(data)
    return read(data)
