"""How well the estimates of a sweep recover the truth: deviations, coverage, verdicts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.diagnostics.findings import Ending
from butterfly.verdict import VERDICTS

if TYPE_CHECKING:
    import pyarrow as pa

_COLUMNS = (
    *("number", "key", "estimator", "ending", "findings", "verdict"),
    *("parameter", "known", "value", "lower", "upper", "true", "deviation", "fit_median"),
)
_MAIN = ("p1", "p3", "p4")


class Recovery(NamedTuple):
    """How one estimator recovers one parameter.

    The deviations from the truth are shares, NaN without any; so is the coverage of 95 % intervals.
    """

    estimator: str
    parameter: str
    runs: int
    median: float
    rms: float
    largest: float
    coverage: float


@dataclass(frozen=True, eq=False)
class Estimates:
    """Estimated parameters of a sweep as (n,) columns."""

    columns: dict[str, NDArray[Any]]

    @classmethod
    def of(cls, table: pa.Table, fields: Sequence[str]) -> Estimates:
        """Take from a result store's table what was estimated, with the fields that varied."""
        wanted = {*_COLUMNS, *fields} & {*table.column_names}
        every = cls({name: column(table, name) for name in wanted})
        return every.take(~every["known"].astype(bool))

    def take(self, rows: NDArray[np.bool_]) -> Estimates:
        """Return the rows that a mask selects."""
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
        """Those whose deviation from the truth is known, which is not 0."""
        return self.take(np.isfinite(self["deviation"]))

    def deviations(self) -> tuple[float, float, float]:
        """Return median, rms and largest size of the known deviations; NaN without any."""
        known = self.deviating["deviation"]
        if not known.size:
            return math.nan, math.nan, math.nan
        rms = float(np.sqrt(np.mean(known**2)))
        return float(np.median(known)), rms, float(np.abs(known).max())

    @property
    def coverage(self) -> float:
        """Share of the intervals that hold the truth; NaN if there is no interval."""
        there = np.isfinite(self["lower"]) & np.isfinite(self["upper"])
        inside = (self["lower"] <= self["true"]) & (self["true"] <= self["upper"])
        return float(inside[there].mean()) if there.any() else math.nan

    def by_estimate(self, name: str) -> dict[tuple[float, str], Any]:
        """Return the value of a column for each run and estimator."""
        estimates = zip(self["number"].tolist(), self["estimator"].tolist(), strict=True)
        return dict(zip(estimates, self[name].tolist(), strict=True))

    @property
    def unconverged(self) -> int:
        """Number of estimates that did not converge."""
        return sum(ending != Ending.CONVERGED for ending in self.by_estimate("ending").values())

    @property
    def verdicts(self) -> dict[str, dict[str, int]]:
        """Number of estimates of each verdict, by estimator."""
        found: dict[str, list[str]] = {each: [] for each in self.estimators}
        for (_, estimator), verdict in self.by_estimate("verdict").items():
            found[estimator].append(verdict)
        return {
            estimator: {each.verdict: verdicts.count(each.verdict) for each in VERDICTS}
            for estimator, verdicts in found.items()
        }

    @property
    def estimators(self) -> list[str]:
        """Names of the estimators."""
        return self.distinct("estimator")

    def worst(self) -> Estimates:
        """Return of each run and estimator the row of p1, p3 or p4 that deviates most."""
        sizes = np.nan_to_num(np.abs(self["deviation"]))
        found: dict[tuple[float, str], int] = {}
        owners = zip(self["number"].tolist(), self["estimator"].tolist(), strict=True)
        for row, (owner, name) in enumerate(zip(owners, self["parameter"], strict=True)):
            if name in _MAIN and (owner not in found or sizes[row] > sizes[found[owner]]):
                found[owner] = row
        return self.take(np.isin(np.arange(sizes.size), list(found.values())))

    def recovery(self) -> Iterator[Recovery]:
        """Yield how well each parameter is recovered, by estimator."""
        for estimator in self.estimators:
            for parameter in self.distinct("parameter"):
                group = self.where(estimator=estimator, parameter=parameter)
                runs = int(group["value"].size)
                if runs:
                    spread = group.deviations()
                    yield Recovery(estimator, parameter, runs, *spread, group.coverage)


def column(table: pa.Table, name: str) -> NDArray[Any]:
    """Return a column as floats, NaN where there is nothing, or as objects."""
    column = table[name]
    if str(column.type) in {"double", "int64"}:
        floats = column.cast("double", safe=False)  # seeds have more digits than a float
        return np.asarray(floats.to_numpy(zero_copy_only=False), dtype=np.float64)
    coded = column.combine_chunks().dictionary_encode()  # few texts, each of them many times
    texts = np.array([*coded.dictionary.to_pylist(), None], dtype=object)
    return np.asarray(texts[coded.indices.fill_null(-1).to_numpy()])
