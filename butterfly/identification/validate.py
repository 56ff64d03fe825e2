"""Cross-validation and bootstrap: how well an estimator predicts held-out logs.

Splits of the data for cross-validation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from numbers import Integral
from typing import NamedTuple

import numpy as np

from butterfly.arrays import Samples, standard_error
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.free_run import FitSummary, FreeRun, fit_of
from butterfly.identification.limits import edges_of
from butterfly.identification.trust import DRAWS, FEW
from butterfly.logs.log import MIN_SAMPLES, Log
from butterfly.progress import Track, counted, out_of_time, untracked
from butterfly.signals.frequency_response import MIN_PERIODS
from butterfly.verdict import CONFIDENCE

FOLDS = 5
"""Parts into which frequencies, logs or time are divided, where there are enough of them."""

Part = Mapping[int, slice]
"""Numbers of logs, and the held-out samples of each."""


class Split(StrEnum):
    """Kinds of data that are held out together."""

    AUTO = "auto"
    MASS = "mass"
    FREQUENCY = "frequency"
    LOG = "log"
    TIME = "time"


@dataclass(frozen=True, kw_only=True)
class Division:
    """Logs divided into parts; one is held out at a time."""

    split: Split  # what the samples of a part have in common; never `Split.AUTO`
    why: str  # why this split was taken, in words
    parts: dict[str, Part]  # the held-out samples of each part, by its name

    @property
    def sentence(self) -> str:
        """The split, and why it was taken."""
        return f"Held out by {self.split}: {self.why}."

    @property
    def left_out(self) -> str:
        """What is held out at a time, in words."""
        if self.split is Split.LOG and all(len(part) == 1 for part in self.parts.values()):
            return "one log held out"
        return _LEFT_OUT[self.split]

    def remainder(self, data: DataSet, name: str) -> DataSet:
        """Return the data set without one part; InputError if the rest cannot be used."""
        samples = self.parts[name]
        whole = [k for k in range(len(data.logs)) if k not in samples]
        if self.split is not Split.TIME:
            return data.take(whole)
        pieces: list[Log] = []
        for number, log in enumerate(data.logs):
            stretch = samples.get(number)
            pieces += [log] if stretch is None else excluding_interval(log, stretch)
        return DataSet.of(pieces, name=data.name, known=data.given)


def divide(data: DataSet, split: Split = Split.AUTO, folds: int | None = None) -> Division:
    """Divide logs into parts.

    ``mass``: one part for each added mass. ``frequency``: the drive frequencies of sines are dealt
    into folds, neighbours into different ones; other logs are always kept. ``log``: logs are dealt
    into folds in their order. ``time``: every log is cut into as many stretches of equal length,
    and each part is one stretch of all. ``auto``: the first of these that suits the logs. There are
    `FOLDS` folds if not given, or fewer where there are fewer frequencies or logs.

    InputError if there cannot be so many folds; IdentifiabilityError if the logs are all of one
    part, which names a split that suits them.
    """
    counted = isinstance(folds, Integral) and folds >= 2  # noqa: PLR2004 - to leave one out
    if folds is not None and (split is Split.MASS or not counted):
        expected = "a whole number of at least 2, with split frequency, log or time"
        raise InputError("validate", "folds", folds, expected)
    why = "as requested"
    if split is Split.AUTO:
        split, why = _suited(data, folds)
    parts = _parts(data, split, folds)
    if len(parts) < 2:  # noqa: PLR2004 - nothing would be left to estimate from
        raise IdentifiabilityError(f"{_why_alike(data, split)}: none can be held out{remedy(data)}")
    return Division(split=split, why=why, parts=parts)


def remedy(data: DataSet, *, other_than: Split = Split.MASS) -> str:
    """Return the name of another split that is possible, after a semicolon; or nothing."""
    others = (
        split for split in (Split.FREQUENCY, Split.LOG, Split.TIME) if split is not other_than
    )
    works = next((split for split in others if _works(data, split)), None)
    return f"; split {works} works with these logs" if works else ""


def _suited(data: DataSet, folds: int | None) -> tuple[Split, str]:
    """Return the most demanding split that is possible with the logs, and why."""
    masses, omegas, count = len(data.masses), len(_frequencies(data)), len(data.logs)
    if masses >= FEW and folds is None:
        return Split.MASS, f"there are {masses} added masses"
    few = f"only {'one' if masses == 1 else masses} added mass{'es' if masses > 1 else ''}"
    if masses >= FEW:
        few = "folds were requested"
    sines = all(log.excitation for log in data.logs)
    if sines and omegas >= FOLDS and _works(data, Split.FREQUENCY, folds):
        return Split.FREQUENCY, f"{few}, but sines at {omegas} frequencies"
    if count >= FEW and _works(data, Split.LOG, folds):
        return Split.LOG, f"{few}, but {count} logs"
    return Split.TIME, f"{few}, and too few logs to hold one out"


def _works(data: DataSet, split: Split, folds: int | None = None) -> bool:
    """Whether the scale remains identifiable without any one part, if it is with all."""
    try:
        parts = _parts(data, split, folds)
    except InputError:
        return False
    if len(parts) < 2:  # noqa: PLR2004 - one left out, one kept
        return False
    if split is Split.TIME or data.known.scale() or len(data.masses) == 1:
        return True
    numbers = range(len(data.logs))
    remaining = (
        {data.logs[k].added_mass for k in numbers if k not in part} for part in parts.values()
    )
    return all(len(masses) > 1 for masses in remaining)


def _parts(data: DataSet, split: Split, folds: int | None) -> dict[str, Part]:
    """Return the held-out samples of each part, by its name."""
    logs = data.logs
    if split is Split.TIME:
        count = folds or FOLDS
        edges = [[*edges_of(log.time, count), log.time.size] for log in logs]
        return {
            f"stretch {k + 1} of {count}": {
                number: slice(*bounds[k : k + 2])
                for number, bounds in enumerate(edges)
                if k + 1 < len(bounds)
            }
            for k in range(count)
        }
    if split is Split.MASS:
        owners = [str(log.added_mass) for log in logs]
        names = list(dict.fromkeys(owners))
    elif split is Split.FREQUENCY:
        omegas = _frequencies(data)
        count = _count(folds, len(omegas), "frequencies")
        names = [f"part {k + 1}" for k in range(count)]
        owners = [
            names[omegas.index(log.excitation.omega) % count] if log.excitation else ""
            for log in logs
        ]
    else:
        count = _count(folds, len(logs), "logs")
        names = [logs[k].name if count == len(logs) else f"fold {k + 1}" for k in range(count)]
        owners = [names[k % count] for k in range(len(logs))]
    return {name: {k: slice(None) for k, one in enumerate(owners) if one == name} for name in names}


def _frequencies(data: DataSet) -> list[float]:
    return sorted({log.excitation.omega for log in data.logs if log.excitation})


def _count(folds: int | None, available: int, what: str) -> int:
    if folds is not None and folds > available:
        raise InputError("validate", "folds", folds, f"at most {available}, the number of {what}")
    return folds or min(FOLDS, available)


def _why_alike(data: DataSet, split: Split) -> str:
    """Return why all logs are of one part."""
    if split is Split.MASS:
        (mass,) = data.masses
        return (
            f"all logs have the same added mass ({mass})"
            if mass.mass
            else "no log has an added mass"
        )
    if split is Split.FREQUENCY:
        return "all sines have the same frequency" if _frequencies(data) else "no log is a sine"
    return "there is only one log"


_LEFT_OUT = {
    Split.MASS: "one added mass held out",
    Split.FREQUENCY: "some frequencies held out",
    Split.LOG: "some logs held out",
    Split.TIME: "a stretch of time held out",
}


def excluding_interval(log: Log, interval: slice) -> list[Log]:
    """Return usable pieces of a log before and after an interval; the second is in motion."""
    first, last, _ = interval.indices(log.time.size)
    sides = {"before": (0, first), "after": (last, log.time.size)}
    pieces = []
    for side, (begin, end) in sides.items():
        if end - begin < MIN_SAMPLES:
            continue
        piece = replace(log.piece(begin, end), name=f"{log.name}, {side}")
        if _usable(piece):
            pieces.append(piece)
    return pieces


def _usable(piece: Log) -> bool:
    """Whether a piece moves, and holds enough periods if it is a sine."""
    if np.ptp(piece.angle) == 0:
        return False
    if piece.excitation is None:
        return True
    return float(np.ptp(piece.time)) * piece.excitation.omega / (2 * math.pi) > MIN_PERIODS + 1


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossValidation:
    """Prediction of held-out data."""

    division: Division  # which data were held out together
    # (n,) FIT in per cent of each log over its held-out samples, each part of it simulated with
    # the estimate from the others; NaN of logs that were never held out
    fits: Samples
    estimates: dict[str, Estimate]  # one for each part left out, by its name
    horizon: float = math.inf  # longest stretch in s that was simulated at a time

    @property
    def summary(self) -> FitSummary:
        """Median, mean and worst FIT."""
        return FitSummary.of(self.fits[~np.isnan(self.fits)], self.horizon)

    def gain_over(self, other: CrossValidation) -> Gain:
        """Return by how much the mean FIT is higher than that of another, log by log."""
        return Gain.of(self.fits - other.fits)

    @property
    def mean(self) -> Gain:
        """The mean FIT, with its standard error over logs."""
        return Gain.of(self.fits)


class Gain(NamedTuple):
    """A mean over logs in per cent of FIT, and its standard error."""

    mean: float
    error: float

    @classmethod
    def of(cls, fits: Samples) -> Gain:
        """Take them from (n,) values of logs, NaN aside; of one log the error is infinite."""
        finite = fits[~np.isnan(fits)]
        return cls(float(finite.mean()), standard_error(finite))


def cross_validate(
    data: DataSet,
    estimator: Callable[[DataSet], Estimate],
    split: Split = Split.AUTO,
    *,
    folds: int | None = None,
    track: Track = untracked,
) -> CrossValidation:
    """Estimate from all logs except one part, predict that part, and repeat for each part.

    Logs are simulated from their first sample, also if a stretch of time is held out; only the
    FIT of that stretch counts. If the estimator finds no encoder zero, that of a held-out added
    mass is the mean angle of its logs.

    InputError if there cannot be so many folds (see `divide`); IdentifiabilityError if there are
    fewer than two parts, or the rest cannot determine the parameters.
    """
    division, predictor = divide(data, split, folds), data.simulations
    squares = np.zeros((len(data.logs), 2))
    estimates: dict[str, Estimate] = {}
    horizon = math.inf
    for name, samples in track(division.parts.items(), f"Cross-validation, {division.left_out}"):
        if estimates and out_of_time("some parts of the cross-validation"):
            break
        try:
            with counted():
                estimate = estimator(division.remainder(data, name))
        except IdentifiabilityError as error:
            raise IdentifiabilityError(_refusal(data, division.split, name, error)) from None
        estimates[name] = estimate
        for number, stretch in samples.items():
            squares[number] += _squares(predictor.run(number, estimate), stretch)
        horizon = min(horizon, predictor.horizon(estimate))
    fits = np.array([fit_of(*pair) if pair.any() else np.nan for pair in np.sqrt(squares)])
    return CrossValidation(division=division, fits=fits, estimates=estimates, horizon=horizon)


def _squares(run: FreeRun, stretch: slice) -> tuple[float, float]:
    """Return sums of squares over a stretch of a log: errors of a free run, and motion."""
    measured = run.log.measured
    with np.errstate(over="ignore", invalid="ignore"):  # of a simulation that diverged
        error = float(np.sum((run.simulated[stretch] - measured[stretch]) ** 2))
    return error, float(np.sum((measured[stretch] - measured.mean()) ** 2))


def _refusal(data: DataSet, split: Split, name: str, error: Exception) -> str:
    """Return why the remaining logs do not suffice, and which split would do."""
    part = f"the logs with {name}" if split is Split.MASS else name
    if split is Split.MASS and len(data.masses) == FEW - 1:
        return (
            f"without {part}, only one added mass remains, and p1..p4 are identifiable only up to "
            "a common factor unless one of them is known (such as known: {p4: ...})"
            f"{remedy(data, other_than=split)}"
        )
    return f"without {part}: {error}{remedy(data, other_than=split)}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Structure:
    """A set of terms with its FIT, in sample and held out."""

    terms: tuple[str, ...]
    in_sample: FitSummary
    held_out: dict[Split, FitSummary]
    gain: Gain | None = None  # held out, over the structure before


def select_terms(
    data: DataSet, estimator: Estimator, candidates: Sequence[str], *, track: Track = untracked
) -> list[Structure]:
    """Return the structures of each round of the stagewise choice, with their held-out FIT.

    One added mass at a time is held out, or what `divide` finds to suit the logs. InputError if the
    estimator does not offer such terms.
    """
    first = divide(data).split
    splits = [first]
    if first is Split.MASS and len({point.omega for point in data.sines}) > 1:
        splits.append(Split.FREQUENCY)
    path = estimator.path(data, tuple(candidates))
    passed: list[Structure] = []
    before: CrossValidation | None = None
    for terms in track(path, "Comparing the structures"):
        if passed and out_of_time("further terms"):
            break
        fixed = estimator.with_terms(terms)
        estimate = fixed(data)
        held = {split: cross_validate(data, fixed.near(estimate), split) for split in splits}
        passed.append(
            Structure(
                terms=terms,
                in_sample=FitSummary.of(data.simulations.fits(estimate)),
                held_out={split: validation.summary for split, validation in held.items()},
                gain=None if before is None else held[first].gain_over(before),
            )
        )
        before = held[first]
    return passed


def cross_validate_choice(
    data: DataSet, estimator: Estimator, candidates: Sequence[str], *, track: Track = untracked
) -> CrossValidation:
    """Hold out a part, choose terms from the rest as `select_terms` does, predict the part.

    So terms are not chosen by the data that judge them (nested cross-validation; Varma & Simon, BMC
    Bioinformatics 7, 2006).
    """

    def of_rest(rest: DataSet) -> Estimate:
        return estimator.with_terms(estimator.path(rest, tuple(candidates))[-1])(rest)

    return cross_validate(data, of_rest, divide(data).split, track=track)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bootstrap:
    """Estimates from resampled logs."""

    values: Samples  # (repetitions, n) estimates
    lower: Samples  # (n,) limits of the percentile intervals at `CONFIDENCE`
    upper: Samples


def bootstrap(
    data: DataSet,
    estimator: Estimator,
    estimate: Estimate,
    *,
    repetitions: int = 200,
    seed: int = 0,
    track: Track = untracked,
) -> Bootstrap:
    """Resample whole logs with replacement, within each added mass, and estimate from them.

    Logs are the blocks: within one, errors are correlated. (Efron & Tibshirani, An Introduction to
    the Bootstrap, 1993, ch. 8.) The terms are those of the estimate from all logs. Draws that
    cannot determine them are drawn again; IdentifiabilityError if hardly any does.
    """
    if repetitions < DRAWS:
        raise InputError("bootstrap", "repetitions", repetitions, f"at least {DRAWS}")
    held = estimator.holding_terms_of(estimate)
    rng = np.random.default_rng(seed)
    groups = [
        [k for k, log in enumerate(data.logs) if log.added_mass == mass] for mass in data.masses
    ]
    values: list[Samples] = []
    failures = 0
    for _ in track(range(repetitions), "Bootstrap"):
        if len(values) >= DRAWS and out_of_time("some bootstrap repetitions"):
            break
        while True:
            rows = [int(k) for group in groups for k in rng.choice(group, len(group))]
            try:
                drawn = held(data.take(rows))
                if lost := [name for name in estimate.names if name not in drawn.names]:
                    listed = ", ".join(lost)
                    raise IdentifiabilityError(
                        f"{listed} cannot be identified from draws of these logs"
                    )
            except IdentifiabilityError:
                failures += 1
                if failures > repetitions:
                    raise
            else:
                values.append(drawn.values)
                break
    tails = 100 * np.array([(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    lower, upper = np.percentile(values, tails, axis=0)
    return Bootstrap(values=np.array(values), lower=lower, upper=upper)
