"""Ranking of estimators over data sets by their held-out FIT."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count

from butterfly.arrays import Samples
from butterfly.errors import ButterflyError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identify import judged
from butterfly.identification.validate import Gain, Split, cross_validate
from butterfly.progress import Track, out_of_time, untracked


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry:
    """One estimator on one data set."""

    data: str  # its name; of several of one name, the later ones are *bench (2)*, *bench (3)*
    method: str  # its label
    in_sample: FitSummary | None  # of the logs that the estimator saw; None if it refused them
    held_out: FitSummary | None  # of what was left out; None if nothing could be
    left_out: str  # what was left out at a time, in words
    estimate: Estimate | None  # from all logs, judged; None if the estimator refused them
    seconds: float  # taken by the fit to all logs, checks included
    error: str  # why there is no estimate, or no held-out FIT
    fits: Samples | None = None  # (n,) FIT in per cent of what was held out of each log


def leaderboard(
    sets: Sequence[DataSet],
    estimators: Sequence[Estimator],
    *,
    split: Split = Split.AUTO,
    track: Track = untracked,
) -> list[Entry]:
    """Validate every estimator on every data set; best held-out median FIT first."""
    named: dict[str, DataSet] = {}
    for data in sets:
        names = (f"{data.name} ({k})" if k > 1 else data.name for k in count(1))
        name = next(candidate for candidate in names if candidate not in named)
        named[name] = replace(data, name=name)
    pairs = [(data, estimator) for data in named.values() for estimator in estimators]
    entries: list[Entry] = []
    for data, estimator in track(pairs, "Comparing estimators"):
        if entries and out_of_time("some of the estimators"):
            break
        entries.append(_entry(data, estimator, split))
    return sorted(entries, key=lambda entry: ([*named].index(entry.data), -_score(entry)))


def equals(entries: Sequence[Entry]) -> list[Entry]:
    """Return, of one data set's entries, the first and those within two standard errors of it."""
    best, *others = entries
    if best.fits is None:
        return [best]
    gains = [(entry, Gain.of(best.fits - entry.fits)) for entry in others if entry.fits is not None]
    return [best, *(entry for entry, gain in gains if not gain.mean > 2 * gain.error)]


def _score(entry: Entry) -> float:
    if entry.held_out is not None:
        return entry.held_out.median
    return -1e3 + (entry.in_sample.median if entry.in_sample is not None else -1e3)


def _entry(data: DataSet, estimator: Estimator, split: Split) -> Entry:
    begun = time.perf_counter()
    estimate, seen, held, error = None, None, None, ""
    seconds = 0.0
    try:
        data, estimate = judged(data, estimator)
        seconds = time.perf_counter() - begun
        seen = FitSummary.of(data.simulations.fits(estimate), estimate.horizon)
        held = cross_validate(data, estimator, split)
    except ButterflyError as problem:
        error = str(problem)
    return Entry(
        data=data.name,
        method=estimator.label,
        in_sample=seen,
        held_out=None if held is None else held.summary,
        left_out="" if held is None else held.division.left_out,
        estimate=estimate,
        seconds=seconds or time.perf_counter() - begun,
        error=error,
        fits=None if held is None else held.fits,
    )
