"""Cross-validation and bootstrap: how well an estimator predicts held-out logs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from butterfly.arrays import Samples, standard_error
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import Estimator
from butterfly.identification.free_run import FitSummary, FreeRun, fit_of
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.levels import CONFIDENCE, DRAWS, FEW
from butterfly.identification.splits import Division, Split, divide, remedy
from butterfly.progress import Track, counted, out_of_time, untracked


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
