"""`residual`: what the model does not explain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

from butterfly.api.sources import Data
from butterfly.api.verbs import Method, estimated, numbers_of_logs
from butterfly.arguments import checked
from butterfly.files import finite
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.residuals import residual_units, residuals_of
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.format import cell_text, label_of
from butterfly.report.log_table import RESIDUAL_CAPTION, about_log, of_logs, residual_row
from butterfly.report.numbers import residual_numbers, rests_on
from butterfly.report.page import Fact, views
from butterfly.result import Answer

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
    from butterfly.report.residual import residual_sentences, with_residual_figures  # noqa: PLC0415 - slow to import

    verdict, residuals = estimate_verdict(estimate), residuals_of(data, estimate)
    worst = max(chosen, key=lambda k: residuals.logs[k].relative)
    title = f"Residuals of {estimate.method} on {data.name!r}"
    rows = finite([about_log(data.logs[k]) | residual_row(residuals.logs[k]) for k in chosen])
    first = max(rows, key=lambda row: math.inf if row[_ERROR] is None else row[_ERROR])
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
