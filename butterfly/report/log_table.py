"""Tables of logs: the first cells of a row, its short name, FITs and residuals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from statistics import median
from typing import Any

import numpy as np

from butterfly.identification.residuals import LogResiduals
from butterfly.logs.log import Log
from butterfly.report.format import fit_text, label_of
from butterfly.report.page import Fact, PageTable

Row = Mapping[str, Any]
"""What is known of a log, by column."""

_SAID_BY_LABEL = {"log", "added mass in kg", "frequency in rad/s"}

RESIDUAL_CAPTION = (
    "Error: rms of measured minus simulated motion, in % of the rms motion, averaged over steps of "
    "the simulation. Next: the part that no small change of the parameters removes, and the error "
    "that encoder resolution and noise explain. Bands: whether autocorrelation and "
    "cross-correlation with the input stay within 95 % bands of sensor noise; one good log in "
    "twenty does not. An error of up to 0.1 % of the motion is ignored: where the error is no "
    "larger, the bands are as wide as the curves can be, and nothing is tested."
)
"""What `residual_row` has."""

RESIDUAL_COLUMNS = (
    *("error in % of the motion", "after small changes in %", "sensor noise in %"),
    *("error over sensor noise", "outside its bands", "missing terms explain in %"),
)


def about_log(log: Log) -> dict[str, Any]:
    """Return the first cells of a log's row: name, added mass and frequency."""
    sine = log.excitation
    return {
        "log": log.name,
        "added mass in kg": log.added_mass.mass,
        "frequency in rad/s": sine.omega if sine else np.nan,
    }


def of_logs(title: str, rows: Sequence[Row], *names: str, **more: Any) -> PageTable:  # noqa: ANN401
    """Tabulate rows of logs, each by its short name; only ``names`` of their columns if given."""
    chosen = names or [name for name in rows[0] if name not in _SAID_BY_LABEL]
    columns: dict[str, Callable[[Row], object]] = {name: itemgetter(name) for name in chosen}
    return PageTable.of(title, rows, {"log": label_of, **columns}, **more)


def fit_facts(rows: Sequence[Row], column: str, label: str) -> list[Fact]:
    """Return median and worst of a column of FITs."""
    fits = {row["log"]: row[column] for row in rows if row[column] is not None}
    if not fits:
        return []
    worst = min(fits, key=lambda name: fits[name])
    return [
        Fact(f"FIT {label}, median", f"{fit_text(median(fits.values()))} %"),
        Fact(f"FIT {label}, worst", f"{fit_text(fits[worst])} %", worst.rsplit("/", 1)[-1]),
    ]


def residual_row(log: LogResiduals) -> dict[str, Any]:
    """Return the residuals of a log as cells of a result's row."""
    shares = (100 * x / (log.motion or np.nan) for x in (log.error, log.remaining, log.explained))
    cells = (*shares, log.times, bool(log.outside), 100 * log.share or np.nan)
    return dict(zip(RESIDUAL_COLUMNS, cells, strict=True))
