"""`compare`: MuJoCo, the grey-box model and the logs, given the same input."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np

from butterfly.api.sources import Data
from butterfly.api.verbs import Method, estimated, numbers_of_logs
from butterfly.arguments import checked
from butterfly.errors import InputError
from butterfly.files import finite
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.residuals import Residuals, residual_units, residuals_of
from butterfly.progress import Track, untracked
from butterfly.report.finding_texts import estimate_verdict, require_values
from butterfly.report.format import counted, label_of
from butterfly.report.log_table import (
    RESIDUAL_CAPTION,
    RESIDUAL_COLUMNS,
    Row,
    about_log,
    fit_facts,
    of_logs,
    residual_row,
)
from butterfly.report.numbers import residual_numbers, rests_on
from butterfly.report.page import Fact, PageTable, views
from butterfly.result import Answer

if TYPE_CHECKING:
    from butterfly.comparison.three_way import ThreeWay  # with MuJoCo, which is slow


_STEPS = "MuJoCo takes the steps of `run`; `export` reports the error of its file in its own."


@checked
def compare(
    data: Data,
    method: Method | None = None,
    *,
    logs: Sequence[int] | None = None,
    hand_mass: float | None = None,
    holdout: Sequence[str] = (),
    track: Track = untracked,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Answer:
    """Simulate logs in MuJoCo and with the grey-box model, both with the identified parameters.

    Parameters
    ----------
    data, method, logs, holdout, options
        As in `residual`.
    hand_mass
        Mass of the moving body in MuJoCo, in kg; the motion does not depend on it. Default: chosen.
    track
        Progress callback.
    """
    from butterfly.comparison.three_way import compare_three  # noqa: PLC0415 - slow to import

    if not isinstance(hand_mass, Real | None):
        raise InputError("compare", "hand_mass", hand_mass, "a number in kg")
    whole, estimator, estimate = estimated(data, method, options, holdout)
    require_values(estimate, "a simulation in MuJoCo")
    numbers = numbers_of_logs("compare", logs, len(whole.logs))
    compared = compare_three(whole, estimate, numbers, mass=hand_mass, track=track)
    return comparison_answer(whole, estimator, compared, residuals_of(whole, estimate), estimate)


def comparison_answer(
    data: DataSet,
    estimator: Estimator | None,
    compared: Sequence[ThreeWay],
    residuals: Residuals,
    estimate: Estimate,
) -> Answer:
    """Tabulate MuJoCo, the grey-box model and the logs, given the same input."""
    from butterfly.report.residual import residual_sentences  # noqa: PLC0415 - slow to import
    from butterfly.report.three_way_page import with_courses  # noqa: PLC0415 - slow to import

    verdict, way = estimate_verdict(estimate), data.joint.way
    title, column = (
        f"MuJoCo, grey-box model and logs of {data.name!r}",
        f"simulators apart in {way}",
    )
    judged = {log.name: log for log in residuals.logs}
    log_residuals = tuple(judged[one.log.name] for one in compared)
    fits = {name: f"FIT {name} in %" for name in compared[0].fits}
    responses = [*_responses(compared[0])]
    rows = finite(
        [
            {
                **about_log(one.log),
                **{fits[name]: fit for name, fit in one.fits.items()},
                column: one.difference,
                **_responses(one),
                **residual_row(log),
            }
            for one, log in zip(compared, log_residuals, strict=True)
        ]
    )
    errors: dict[str, Callable[[Row], object]] = {"log": label_of}
    errors |= {name: _signed(name) for name in responses}
    tables = [
        of_logs(title, rows, *fits.values(), column),
        PageTable.of("Amplitude and phase", rows, errors, detail=True),
        of_logs("Residuals", rows, *RESIDUAL_COLUMNS, caption=RESIDUAL_CAPTION),
    ]
    difference = f"{max(one.difference for one in compared):.2g} {way}"
    facts = [
        *fit_facts(rows, fits["MuJoCo"], "of MuJoCo"),
        *fit_facts(rows, fits["grey box"], "of the grey box"),
        Fact("MuJoCo − grey box", difference, "largest difference"),
        Fact("logs compared", str(len(rows)), f"of {len(data.logs)}"),
    ]
    return Answer(
        kind="comparison",
        title=title,
        summary=(
            *verdict.after(_comparison_sentence(compared)),
            _STEPS,
            *residual_sentences(replace(residuals, logs=log_residuals)),
        ),
        judged=verdict,
        content={
            **rests_on(data, estimate, estimator),
            "rows": rows,
            "residuals": residual_numbers(residuals, estimate),
            **views(tables, facts, "fits", "frequency"),
        },
        units=residual_units(data.joint),
        live=partial(with_courses, compared, log_residuals),
    )


def _responses(comparison: ThreeWay) -> dict[str, float]:
    """Return how the steady responses of the simulators differ from that of the log."""
    cells = {}
    for name in comparison.fits:
        gain = comparison.gains.get(name, complex(np.nan, np.nan))
        cells[f"amplitude error {name} in %"] = float(100 * (np.abs(gain) - 1))
        cells[f"phase error {name} in °"] = float(np.degrees(np.angle(gain)))
    return cells


def _signed(name: str) -> Callable[[Row], str]:
    """Return the cell of an error, with its sign; a dash for none."""
    return lambda row: "–" if row[name] is None else f"{row[name]:+.2g}"


def _comparison_sentence(compared: Sequence[ThreeWay]) -> str:
    """State how far the simulators are from each other, and the fit of both."""
    difference = max(comparison.difference for comparison in compared)
    way = compared[0].log.added_mass.joint.way
    fits = {
        key: np.array([comparison.fits[key] for comparison in compared]) for key in compared[0].fits
    }
    medians = ", ".join(
        f"{key} {np.median(fit):.2f} % (worst {fit.min():.2f} %)" for key, fit in fits.items()
    )
    return (
        f"MuJoCo and grey box differ by at most {difference:.2g} {way}, with the same parameters "
        f"and recorded input of {counted(len(compared), 'log')}. Median FIT: {medians}."
    )
