"""The tables of a sweep from its records, and the recovery of the true parameters."""

from __future__ import annotations

import json
import math
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from butterfly.experiment.record import EstimateRecord, OrbitRecord, RunRecord, SweepRun
from butterfly.identification.trust import Ending, Parameter, meaning_of, or_none, unit_of
from butterfly.verdict import VERDICTS

RUNS, ESTIMATES = "runs", "estimates"
TABLES = (RUNS, ESTIMATES)
"""Names of the tables."""

MISSING = "missing"
"""Status of a run without a record in the table of runs."""

_TEXT, _NUMBER, _COUNT, _TRUTH = pa.string(), pa.float64(), pa.int64(), pa.bool_()

_COLUMNS = (
    *("number", "key", "estimator", "ending", "findings", "verdict"),
    *("parameter", "known", "value", "lower", "upper", "true", "deviation", "fit_median"),
)
_LARGEST = sys.float_info.max

_Row = TypeVar("_Row")


Column: TypeAlias = tuple[pa.DataType, Callable[[_Row], Any]]
"""A column: its type, and its value for a row."""


def _of_orbit(value: Callable[[OrbitRecord], Any], kind: pa.DataType = _NUMBER) -> _OfRun:
    """Column of a value of an orbit's record, if any."""
    return kind, lambda record: value(record.orbit) if record and record.orbit else None


_OfRun: TypeAlias = Column[RunRecord | None]
_OfParameter: TypeAlias = tuple[pa.DataType, Callable[[EstimateRecord, Parameter], Any]]


def _of_row(name: str, kind: pa.DataType = _NUMBER) -> _OfParameter:
    """Column of a number of a parameter's row in the estimate's table."""
    return kind, lambda _, row: getattr(row, name)


_PLACE: dict[str, Column[SweepRun]] = {
    "number": (_COUNT, lambda run: run.number),
    "key": (_TEXT, lambda run: run.key),
    "repetition": (_COUNT, lambda run: run.repetition),
    "seed": (_COUNT, lambda run: run.seed),
}

_RUN: dict[str, _OfRun] = {
    "status": (_TEXT, lambda record: record.status if record else MISSING),
    "error": (_TEXT, lambda record: record.reason if record else "not run"),
    "logs": (_COUNT, lambda record: record.logs if record else None),
    "verdict": (_TEXT, lambda record: record.verdict if record else None),
    "unconverged": (_COUNT, lambda record: record.unconverged if record else None),
    "orbit_rounds": _of_orbit(lambda o: len(o.amplitudes_rad or o.speeds_rad_s), _COUNT),
    "orbit_target": _of_orbit(lambda orbit: orbit.target_rad),
    "orbit_amplitude": _of_orbit(lambda orbit: next(iter(orbit.amplitudes_rad[-1:]), None)),
    "orbit_target_speed": _of_orbit(lambda orbit: orbit.target_rad_s),
    "orbit_speed": _of_orbit(lambda orbit: next(iter(orbit.speeds_rad_s[-1:]), None)),
    "orbit_differing": _of_orbit(
        lambda orbit: ", ".join(orbit.also.differing) if orbit.also else None, _TEXT
    ),
    "orbit_error_generic": _of_orbit(lambda orbit: orbit.free_run_rms_rad.get("generic")),
    "orbit_error_recalibrated": _of_orbit(
        lambda orbit: orbit.free_run_rms_rad.get("re-calibrated")
    ),
}


def _of_fit(which: str, statistic: str) -> _OfParameter:
    """Column of a statistic of FIT, if any."""
    return _NUMBER, lambda record, _: getattr(getattr(record, which), statistic, None)


_ESTIMATE: dict[str, _OfParameter] = {
    "estimator": (_TEXT, lambda record, _: record.estimator),
    "verdict": (_TEXT, lambda record, _: record.verdict),
    "ending": (_TEXT, lambda record, _: record.ending),
    "findings": (_TEXT, lambda record, _: ", ".join(record.findings)),
    "parameter": _of_row("name", _TEXT),
    "on_bound": _of_row("on_bound", _TRUTH),
    "known": _of_row("known", _TRUTH),
    **{
        name: _of_row(name)
        for name in (
            *("value", "standard_error", "lower", "upper", "least_left_out", "largest_left_out"),
            *("true", "deviation"),
        )
    },
    "condition": (_NUMBER, lambda record, _: record.condition),
    "fit_median": _of_fit("fit", "median"),
    "fit_mean": _of_fit("fit", "mean"),
    "fit_worst": _of_fit("fit", "worst"),
    "held_out_median": _of_fit("held_out", "median"),
    "held_out_worst": _of_fit("held_out", "worst"),
    "holdout_median": _of_fit("holdout", "median"),
    "holdout_worst": _of_fit("holdout", "worst"),
}


class SweepColumns:
    """The columns of a sweep's tables: fixed ones, and one per varied field."""

    def __init__(self, fields: Sequence[str], runs: Sequence[SweepRun]) -> None:
        varied = [field for field in fields if field != "seed"]  # it has a column anyway
        self._fields = {name: _kind(run.overrides.get(name) for run in runs) for name in varied}

    def schema(self, table: str) -> pa.Schema:
        """Return the names and types of a table's columns."""
        place = {name: kind for name, (kind, _) in _PLACE.items()}
        columns: dict[str, tuple[pa.DataType, Any]] = {**(_RUN if table == RUNS else _ESTIMATE)}
        rest = {name: kind for name, (kind, _) in columns.items()}
        return pa.schema(list((place | self._fields | rest).items()))

    def rows(self, table: str, run: SweepRun, record: RunRecord | None) -> Iterator[dict[str, Any]]:
        """Yield the rows of a table for a run."""
        place = {name: value(run) for name, (_, value) in _PLACE.items()}
        place |= {f: _cell(run.overrides.get(f), kind) for f, kind in self._fields.items()}
        if table == RUNS:
            yield place | {name: value(record) for name, (_, value) in _RUN.items()}
            return
        for estimate in record.estimates if record else ():
            for row in estimate.parameters:
                yield place | {name: value(estimate, row) for name, (_, value) in _ESTIMATE.items()}


def _kind(values: Iterable[Any]) -> pa.DataType:
    """Type of a column for some values: numbers, booleans, or else texts."""
    given = [value for value in values if value is not None]
    if given and all(isinstance(value, bool) for value in given):
        return _TRUTH
    numbers = (
        isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST
        for value in given
    )
    return _NUMBER if all(numbers) else _TEXT


def _cell(value: Any, kind: pa.DataType) -> Any:  # noqa: ANN401 - whatever a field may be set to
    if value is None or kind == _TRUTH:
        return value
    if kind == _NUMBER:
        return float(value)
    if isinstance(value, dict) and not any(isinstance(v, dict | list) for v in value.values()):
        return ", ".join(f"{key} {part}" for key, part in value.items())
    return json.dumps(value, default=str) if isinstance(value, dict | list) else str(value)


@dataclass(frozen=True, eq=False)
class Estimates:
    """Estimated parameters of a sweep as (n,) columns."""

    columns: dict[str, NDArray[Any]]

    @classmethod
    def of(cls, table: pa.Table, fields: Sequence[str]) -> Estimates:
        """Return the estimates of a result store's table, with the varied fields."""
        wanted = {*_COLUMNS, *fields} & {*table.column_names}
        every = cls({name: column(table, name) for name in wanted})
        return every.take(~every["known"].astype(bool))

    def take(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> Estimates:
        """Return the rows that a mask selects, or numbers of rows."""
        return Estimates({name: column[rows] for name, column in self.columns.items()})

    def where(self, **values: object) -> Estimates:
        """Return the rows with these values in the columns of these names."""
        masks = [self[name] == value for name, value in values.items()]
        return self.take(np.logical_and.reduce(masks))

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    def distinct(self, name: str) -> list[Any]:
        """Return the different values of a column, in the order of their first row."""
        return list(dict.fromkeys(self[name].tolist()))

    @property
    def deviating(self) -> Estimates:
        """Rows with a known deviation from a true value other than 0."""
        return self.take(np.isfinite(self["deviation"]))

    @property
    def coverage(self) -> float:
        """Fraction of intervals that contain the truth; NaN without intervals."""
        there = np.isfinite(self["lower"]) & np.isfinite(self["upper"])
        inside = (self["lower"] <= self["true"]) & (self["true"] <= self["upper"])
        return float(inside[there].mean()) if there.any() else math.nan

    def by_estimate(self, name: str) -> dict[tuple[float, str], Any]:
        """Return the value of a column for each run and estimator."""
        estimates = zip(self["number"].tolist(), self["estimator"].tolist(), strict=True)
        return dict(zip(estimates, self[name].tolist(), strict=True))

    @property
    def median_fit(self) -> float:
        """Median over estimates of the median FIT of their logs, in %."""
        fits = np.array([*self.by_estimate("fit_median").values()], dtype=float)
        return float(np.median(fits[np.isfinite(fits)])) if np.isfinite(fits).any() else math.nan

    @property
    def unconverged(self) -> int:
        """Number of estimates that did not converge."""
        return sum(ending != Ending.CONVERGED for ending in self.by_estimate("ending").values())

    @property
    def verdicts(self) -> dict[str, dict[str, int]]:
        """Number of estimates of each verdict, by estimator."""
        counts = Counter(
            (name, verdict) for (_, name), verdict in self.by_estimate("verdict").items()
        )
        return {
            name: {level.verdict: counts[name, level.verdict] for level in VERDICTS}
            for name in self.estimators
        }

    @property
    def estimators(self) -> list[str]:
        """Names of the estimators."""
        return self.distinct("estimator")

    def worst(self) -> Estimates:
        """Return the row with the largest deviation, per run and estimator."""
        sizes = np.nan_to_num(np.abs(self["deviation"]))
        rows: dict[tuple[float, str], int] = {}
        owners = zip(self["number"].tolist(), self["estimator"].tolist(), strict=True)
        for row, owner in enumerate(owners):
            if owner not in rows or sizes[row] > sizes[rows[owner]]:
                rows[owner] = row
        return self.take(np.isin(np.arange(sizes.size), list(rows.values())))

    def rows(self) -> list[Parameter]:
        """Return its rows as they are in the table of an estimate."""
        names = ("value", "lower", "upper", "true")
        numbers = (map(or_none, self[name].tolist()) for name in names)
        return [
            Parameter(
                name=name,
                meaning=meaning_of(name),
                unit=unit_of(name),
                value=value,
                lower=lower,
                upper=upper,
                true=true,
            )
            for name, value, lower, upper, true in zip(
                self["parameter"].tolist(), *numbers, strict=True
            )
        ]

    def recovery(self) -> Iterator[dict[str, Any]]:
        """Yield a row per estimator and parameter: deviations as shares (NaN of none), coverage."""
        for estimator in self.estimators:
            for parameter in self.distinct("parameter"):
                group = self.where(estimator=estimator, parameter=parameter)
                if runs := int(group["value"].size):
                    known = group.deviating["deviation"]
                    known = known if known.size else np.array([math.nan])
                    yield {
                        "estimator": estimator,
                        "parameter": parameter,
                        "runs": runs,
                        "median_deviation": float(np.median(known)),
                        "rms_deviation": float(np.sqrt(np.mean(known**2))),
                        "largest_deviation": float(np.abs(known).max()),
                        "coverage": group.coverage,
                    }


def column(table: pa.Table, name: str) -> NDArray[Any]:
    """Return a column as floats, NaN if missing, or as objects."""
    column = table[name]
    if str(column.type) in {"double", "int64"}:
        floats = column.cast("double", safe=False)  # seeds have more digits than a float
        return np.asarray(floats.to_numpy(zero_copy_only=False), dtype=np.float64)
    coded = column.combine_chunks().dictionary_encode()  # few texts, each of them many times
    texts = np.array([*coded.dictionary.to_pylist(), None], dtype=object)
    return np.asarray(texts[coded.indices.fill_null(-1).to_numpy()])
