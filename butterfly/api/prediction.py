"""`predict`, `draws` and `residual`: what follows from an identification, and what it leaves."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from butterfly.api.identification import Identification
from butterfly.api.saved import Drawn, Predicted
from butterfly.api.sources import Data, Named, is_data, read
from butterfly.api.verbs import Method, estimated, numbers_of_logs, require_identification
from butterfly.arguments import checked
from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.experiment.run import planned_logs
from butterfly.experiment.schema import Experiment
from butterfly.experiment.source import read_experiment
from butterfly.files import finite, locate
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.free_run import Setting
from butterfly.identification.identified import given_estimate
from butterfly.identification.physical import judge_fit
from butterfly.identification.predict import (
    LEAST,
    ExpectedErrors,
    ParameterDraws,
    draw_parameters,
    expected_errors,
    predict_logs,
    require_draws,
)
from butterfly.identification.residuals import residual_units, residuals_of
from butterfly.identification.trust import FindingKind
from butterfly.logs.log import InputKind, Log
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.prior import Known
from butterfly.progress import Track, untracked
from butterfly.report.finding_texts import estimate_verdict, require_possible, require_values
from butterfly.report.format import cell_text, label_of
from butterfly.report.inspection import RESIDUAL_CAPTION, about_log, of_logs, residual_row
from butterfly.report.numbers import residual_numbers, rests_on
from butterfly.report.page import Fact, views
from butterfly.result import Answer

BAND_DRAWS = 200
"""Default number of draws of a band: five are expected beyond either edge."""


_NO_ERRORS = "The band of a new log is missing: it needs the errors of these logs."


@checked
def predict(
    data: Data | Experiment,
    result: Identification | Named | LumpedParameters | Mapping[str, object],
    *,
    bands: bool | None = None,
    draws: int = BAND_DRAWS,
    seed: int = 0,
    track: Track = untracked,
) -> Predicted:
    """Predict logs, or a new experiment, with known parameters.

    Simulates each log from its initial angle with the recorded input alone. The verdict says
    whether the parameters reproduce the logs. With ``bands`` there are two 95 % bands: one for the
    uncertainty of the parameters, one for a new log (with the model error).

    Parameters
    ----------
    data
        Logs, a folder of logs, a manifest, a saved result, an experiment (to simulate its inputs),
        or a shipped name. Anything else that `read` takes, its result or `read_experiment`'s.
    result
        A saved result, or parameters: p1=0.18,p3=3.7,coulomb=0.01. Others are 0; without p4 the
        best-fitting one is used, without zero the logs' own encoder zero. In Python an
        `Identification`, `LumpedParameters`, or a mapping of parameters.
    bands
        Compute 95 % bands. Default: if `result` is an identification.
    draws
        Number of parameter draws, for the bands and the command's --out.
    seed
        Random seed.
    track
        Progress callback.
    """
    require_draws(BAND_DRAWS if bands is False else draws, seed)
    source = _source(data)
    logs: Sequence[Log]
    errors: Sequence[ExpectedErrors] = ()
    sentences: tuple[str, ...] = ()
    open_draws: ParameterDraws | None = None
    drawn: Drawn | None = None
    if isinstance(source, Experiment):
        logs, whole = planned_logs(source), None

        def setting(number: int, estimate: Estimate) -> Setting:
            """Start at rest, with the encoder zero at the hanging position."""
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
            why = "bands need an identification: plain parameters have no covariance"
            raise IdentifiabilityError(why)
        sentences = _of_gain(given, estimate, whole)
    else:
        identification = require_identification(result)
        require_values(identification.estimate, "a prediction")
        kind = identification.origin["input"]
        if source.input_kind not in {kind, InputKind.NONE}:
            expected = f"{kind}, the input kind of the identification"
            raise InputError("predict", "input", str(source.input_kind), expected)
        estimate = identification.estimate
        if bands is not False:
            open_draws, seen, remarks = _physical_draws(identification, masses, draws, seed)
            sentences = (f"{draws} parameter draws, all with the same weight.", *remarks)
            if seen is None:
                sentences = (*sentences, _NO_ERRORS)
            else:
                errors = expected_errors(seen, estimate)
                sentences = (*sentences, _of_errors(errors), *_beyond(seen.masses, logs))
            drawn = Drawn.of(open_draws, identification, sentences)
    predictions = predict_logs(
        logs, estimate, setting, draws=open_draws, errors=errors, track=track
    )
    if whole is not None:
        fits = np.array([predictions[k].run.followed for k in whole.counted])
        estimate = _judged(estimate, fits)
    return Predicted.of(
        source.name, predictions, sentences, estimate, drawn=drawn, measured=whole is not None
    )


@checked
def draws(result: Identification | Named, n: int = BAND_DRAWS, seed: int = 0) -> Drawn:
    """Draw parameters from the uncertainty of an identification, for domain randomisation.

    Draws are normally distributed within the parameters' bounds, all with the same weight.

    Parameters
    ----------
    result
        An `Identification` or its saved file.
    n
        Number of draws.
    seed
        Random seed.
    """
    identification = require_identification(result)
    require_values(identification.estimate, "a draw")
    if n < 1:
        raise InputError("draws", "n", n, "1 or more")
    drawn, _, remarks = _physical_draws(identification, (), max(n, LEAST), seed)
    return Drawn.of(replace(drawn, values=drawn.values[:n]), identification, remarks)


def _judged(estimate: Estimate, fits: Samples) -> Estimate:
    """Return an estimate with the finding that it does not follow predicted logs, if so.

    What the error of the logs was that were fitted then says nothing.
    """
    poor = judge_fit(fits)
    kinds = {FindingKind.FOLLOWED} if poor else set()
    rest = (finding for finding in estimate.findings if finding.kind not in kinds)
    return replace(estimate, findings=(*rest, *poor))


def _physical_draws(
    identification: Identification, masses: Iterable[AddedMass], count: int, seed: int
) -> tuple[ParameterDraws, DataSet | None, list[str]]:
    """Return draws that make a joint with all masses, the logs, and what to say."""
    data, remarks = None, []
    try:
        data = identification.data
    except InputError as error:
        remarks = [f"The logs cannot be read ({error}): their added masses do not limit the draws."]
    logged = data.masses if data else []
    drawn = draw_parameters(identification.estimate, count, masses=[*masses, *logged], seed=seed)
    return drawn, data, remarks


def _of_gain(
    given: Mapping[str, object], estimate: Estimate, data: DataSet | None
) -> tuple[str, ...]:
    """State the best-fitting p4 if none was given."""
    known = {} if data is None else data.known.fixed
    gain = (known | dict(given)).get("p4", math.nan)
    if isinstance(gain, float) and math.isnan(gain):
        return (f"p4 was not given; p4 = {estimate.parameters.p4:.4g} fits best.",)
    return ()


def _of_errors(errors: Sequence[ExpectedErrors]) -> str:
    unseen, count = sum(error.held_out for error in errors), len(errors)
    clause = f"The band of a new log comes from the errors of {count} logs"
    if unseen == count:
        return f"{clause}, each predicted with its added mass held out."
    fitted = "each" if not unseen else f"{count - unseen} of them"
    return f"{clause}, {fitted} fitted with its added mass: it may be too narrow for another mass."


def _beyond(seen: Sequence[AddedMass], logs: Iterable[Log]) -> list[str]:
    """Name the added masses outside the range of the identification."""
    least, largest = (limit(seen, key=lambda mass: mass.inertia) for limit in (min, max))
    beyond = {
        str(log.added_mass)
        for log in logs
        if not least.inertia <= log.added_mass.inertia <= largest.inertia
    }
    if not beyond:
        return []
    return [
        f"{', '.join(sorted(beyond))}: extrapolation beyond the added masses of the identification "
        f"({least} to {largest})."
    ]


def _source(data: Any) -> DataSet | Experiment:  # noqa: ANN401 - whatever was given
    if isinstance(data, Experiment):
        return data
    if isinstance(data, str | PathLike) and str(data) and not is_data(locate(Path(data))):
        return read_experiment(data)
    return read(data)


_ERROR = "error in % of the motion"  # column


@checked
def residual(
    data: Data,
    method: Method | None = None,
    *,
    logs: Sequence[int] | None = None,
    holdout: Sequence[str] = (),
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Answer:
    """Analyse the residuals, and name the terms that the model is missing.

    Compares each log's free-run error with the sensor noise, and tests its correlations.

    Parameters
    ----------
    data
        A saved result; or logs, a folder of logs, a manifest or a shipped data set's name, to
        identify first. An `Identification`; anything else that `read` takes, or its result.
    method, holdout, options
        As in `identify`; none with a result, which has an estimate.
    logs
        Numbers of the logs to show, from 0. Default: all.
    """
    whole, estimator, estimate = estimated(data, method, options, holdout)
    numbers = numbers_of_logs("residual", logs, len(whole.logs))
    return residual_answer(whole, estimator, estimate, numbers)


def residual_answer(
    data: DataSet, estimator: Estimator | None, estimate: Estimate, chosen: Sequence[int]
) -> Answer:
    """Analyse the residuals of an estimate, and tabulate those of the chosen logs."""
    from butterfly.report.log_figures import residual_sentences, with_residual_figures  # noqa: PLC0415 - slow to import

    verdict, residuals = estimate_verdict(estimate), residuals_of(data, estimate)
    worst = max(chosen, key=lambda k: (residuals.logs[k].counted, residuals.logs[k].relative))
    title = f"Residuals of {estimate.method} on {data.name!r}"
    rows = finite([about_log(data.logs[k]) | residual_row(residuals.logs[k]) for k in chosen])
    first = rows[[*chosen].index(worst)]
    error, times = (cell_text(first[key]) for key in (_ERROR, "error over sensor noise"))
    facts = [
        Fact("largest error", f"{error} %", f"of the motion, {label_of(first)}"),
        Fact("over sensor noise", f"{times} ×", "encoder resolution and noise"),
        Fact("correlations", "outside" if first["outside its bands"] else "inside", "bands"),
    ]
    return Answer(
        kind="residual",
        title=title,
        summary=(*verdict.lines, *residual_sentences(residuals)),
        judged=verdict,
        content={
            **rests_on(data, estimate, estimator),
            "rows": rows,
            "residuals": residual_numbers(residuals, estimate),
            **views([of_logs(title, rows, caption=RESIDUAL_CAPTION)], facts),
        },
        units=residual_units(data.joint),
        live=partial(with_residual_figures, data, estimate, worst, residuals.logs[worst]),
    )
