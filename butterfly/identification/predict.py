"""Prediction of a joint's motion under a given input, with two bands about its free run.

The band of the parameters includes the motion of the model with parameters drawn from the
estimate; that of a new log includes a recording: to each draw are added the errors of a held-out
log. Both are pointwise, at `CONFIDENCE`.

Parameters are drawn from a normal distribution about the estimate. Its covariance is that of the
scatter of the data, widened as the intervals are: along the differences of the leave-one-mass-out
estimates, as if each were a limit of its interval, and by a common factor until no parameter has a
smaller half-width than its interval. So well-determined combinations stay precise. A draw beyond a
bound is moved to it, and the other parameters by their correlation with it. The normal distribution
is the asymptotic one (Gelman et al., Bayesian Data Analysis, 3rd ed. 2013, section 4.1).

The error of a new log is that of a log whose added mass was held out. Where none can be left out,
errors in sample replace it, larger by sqrt(1 + 1/G): a further mass differs from the mean of G
exchangeable ones by (1 + 1/G) times their variance. A whole log with another mass is the donor of
errors, drawn in blocks of whole drive periods (the circular block bootstrap: Politis & Romano, in
Exploring the Limits of Bootstrap, 1992). Their size is that of the model's error, which follows the
motion, and of the sensor's noise, which does not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples, unit_diagonal
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FreeRun, Setting
from butterfly.identification.limits import length_of, widened
from butterfly.identification.sensor_errors import SensorErrors
from butterfly.identification.trust import DRAWS
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.terms import lower_bounds
from butterfly.progress import Track, in_threads, out_of_time, untracked
from butterfly.verdict import CONFIDENCE, SPREADS

OF_PARAMETERS = "parameters"
OF_NEW_LOG = "new log"
"""Names of the two bands."""

_STEP = 0.02  # s, between the samples at which a band is computed
_TAILS = ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2)

LEAST = 2 * DRAWS
"""Fewest draws: one is expected beyond either edge of a band."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ParameterDraws:
    """Parameters drawn from the distribution of an estimate."""

    estimate: Estimate
    values: Samples  # (m, n) of its n parameters
    seed: int = 0  # of these draws, and of the errors that are drawn for them

    @property
    def parameters(self) -> list[LumpedParameters]:
        """Each draw as parameters of the bare hand."""
        return [estimate.parameters for estimate in self.estimates()]

    def estimates(self, horizon: float | None = None) -> Iterator[Estimate]:
        """Yield the estimate with the values of each draw, to simulate logs over a horizon in s."""
        estimate = self.estimate if horizon is None else replace(self.estimate, horizon=horizon)
        for values in self.values:
            yield replace(estimate, values=values)


def require_draws(count: int, seed: int) -> None:
    """Raise InputError if fewer draws than `LEAST` are asked for, or the seed is negative."""
    if count < LEAST:
        raise InputError("draws", "count", count, f"at least {LEAST}")
    if seed < 0:
        raise InputError("draws", "seed", seed, "0 or more")


def draw_parameters(
    estimate: Estimate, count: int, *, masses: Iterable[AddedMass] = (), seed: int = 0
) -> ParameterDraws:
    """Draw parameters within their bounds, with equal weights.

    Each draw makes a joint with each of the added ``masses``: of inertia p1 + Z > 0 and without
    negative friction. InputError if fewer than `LEAST` are asked for, or the seed is negative;
    IdentifiabilityError without a covariance, or if hardly any draw is possible.
    """
    require_draws(count, seed)
    covariance = honest_covariance(estimate)
    lower, rng = lower_bounds(estimate.names) - estimate.values, np.random.default_rng(seed)
    different, root = tuple(set(masses)), covariance_root(covariance)
    draws: list[Samples] = []
    for _ in range(count):
        moved = rng.standard_normal((count, root.shape[0])) @ root
        for row in np.flatnonzero(np.any(moved < lower, axis=1)):
            moved[row] = _within(moved[row], lower, covariance)
        draws.extend(moved[_possible(moved, estimate, different)])
        if len(draws) >= count:
            break
    else:
        raise IdentifiabilityError(
            f"the intervals are too wide: hardly any of {count**2} drawn sets of parameters is "
            "physical (positive inertia, friction that brakes)"
        )
    return ParameterDraws(estimate=estimate, values=estimate.values + draws[:count], seed=seed)


def honest_covariance(estimate: Estimate) -> Samples:
    """(n, n) covariance widened as the intervals are by fits that predict as well."""
    widths = estimate.farther
    if not (np.isfinite(estimate.covariance).all() and np.isfinite(widths).all()):
        raise IdentifiabilityError(
            f"the method {estimate.method!r} gives no covariance, which drawing parameters needs"
        )
    evidence = estimate.evidence
    likely = [rival for rival in evidence.rivals if rival.predicts]
    by_fits = replace(evidence, rivals=likely, bias=None)
    widths = np.minimum(by_fits.half_widths, widths)
    values = [rival.values for rival in likely]
    covariance = widened(estimate.values, estimate.covariance, evidence.left_out, values)
    spread = np.sqrt(np.diag(covariance))
    varies = spread > 0
    factor = np.max(widths[varies] / spread[varies], initial=0.0) / SPREADS
    return np.asarray(covariance * max(factor, 1.0) ** 2)


def covariance_root(covariance: Samples) -> Samples:
    """(n, n) root of a covariance, by which rows of standard normal numbers are multiplied."""
    correlation, spread = unit_diagonal(covariance)
    eigenvalues, axes = np.linalg.eigh(correlation)
    return np.asarray(np.sqrt(np.maximum(eigenvalues, 0.0))[:, None] * axes.T * spread)


def _within(moved: Samples, lower: Samples, covariance: Samples) -> Samples:
    """Return (n,) changes moved to violated (n,) bounds, the others by their correlation."""
    bound = moved < lower
    result = moved
    for _ in range(moved.size):
        back = np.linalg.lstsq(
            covariance[np.ix_(bound, bound)], moved[bound] - lower[bound], rcond=None
        )[0]
        result = np.where(bound, lower, moved - covariance[:, bound] @ back)
        if np.all(result >= lower):
            break
        bound |= result < lower
    return np.asarray(result)


def _possible(moved: Samples, estimate: Estimate, masses: Iterable[AddedMass]) -> NDArray[np.bool_]:
    """(m,) whether (m, n) changes of the estimate make a joint with each mass."""
    possible = np.ones(len(moved), dtype=bool)
    for row, values in enumerate(estimate.values + moved):
        parameters = replace(estimate, values=values).parameters
        loaded = [parameters.with_added_mass(mass) for mass in masses]
        possible[row] = all(joint.p1 > 0 and joint.coulomb >= 0 for joint in loaded)
    return possible


@dataclass(frozen=True, kw_only=True, eq=False)
class Band:
    """(m,) limits of m expected angles in rad, or velocities in rad/s."""

    lower: Samples
    upper: Samples

    @property
    def width(self) -> float:
        """Mean distance in rad of the edges."""
        return float(np.mean(self.upper - self.lower))

    def share(self, angle: Samples) -> float:
        """Return the share of (m,) angles inside."""
        return float(np.mean((self.lower <= angle) & (angle <= self.upper)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """A log predicted: its free run with the estimate, and bands about it."""

    run: FreeRun
    samples: NDArray[np.intp]  # numbered (m,), at which the bands are
    bands: dict[str, Band]  # `OF_PARAMETERS` and `OF_NEW_LOG`, as far as there are any
    setting: Setting  # of the free run

    @property
    def time(self) -> Samples:
        """(m,) stamps in s of the bands."""
        return self.run.log.time[self.samples]

    @property
    def measured(self) -> Samples:
        """(m,) measured signal at these instants."""
        return self.run.log.measured[self.samples]


@dataclass(frozen=True, kw_only=True, eq=False)
class ExpectedErrors:
    """Errors of one log, larger by sqrt(1 + 1/G) if its mass was one of G that were fitted."""

    log: Log
    relative: Samples  # (n,) measured less simulated angle, over the rms of the log's motion
    held_out: bool  # whether the estimate was made without its added mass
    noise: float = 0.0  # of the sensor in rad, by standard deviation

    def scale(self, motion: float) -> float:
        """Return what the relative errors of a log are multiplied by, whose rms motion is given."""
        rms, size = self.log.rms_measured, float(np.sqrt(np.mean(np.square(self.relative))))
        steady = min(self.noise / rms, size)
        model = math.sqrt(size**2 - steady**2) * motion
        return math.hypot(model, steady * rms) / size if size else 0.0

    def drawn(self, time: Samples, rng: np.random.Generator) -> Samples:
        """(m,) relative errors of samples at (m,) instants in s, in blocks from anywhere."""
        clock = self.log.time - self.log.time[0]
        length = min(length_of(self.log), float(clock[-1]))
        number = ((time - time[0]) / length).astype(np.intp)
        starts = rng.uniform(0, clock[-1], number[-1] + 1)
        instants = starts[number] + (time - time[0]) - number * length
        samples = np.searchsorted(clock, instants % clock[-1], side="right") - 1
        return np.asarray(self.relative[samples])


def expected_errors(data: DataSet, estimate: Estimate) -> list[ExpectedErrors]:
    """Return the errors of the logs that made an estimate, those without motion left out."""
    errors = []
    further = math.sqrt(1 + 1 / len(data.masses))
    for number, log in enumerate(data.logs):
        motion = log.rms_measured
        if not motion:
            continue
        others = estimate.left_out.get(log.added_mass)
        fitted = estimate if others is None else replace(estimate, values=others)
        run = data.simulations.run(number, fitted)
        relative = (log.measured - run.simulated) / motion * (further if others is None else 1.0)
        noise = SensorErrors.of(log.measured, run.simulated).spread
        left_out = others is not None
        errors.append(ExpectedErrors(log=log, relative=relative, held_out=left_out, noise=noise))
    return errors


def donors(errors: Sequence[ExpectedErrors], mass: AddedMass) -> list[ExpectedErrors]:
    """Return the logs with other added masses than one; all if there are none."""
    alike = mass.inertia_and_moment
    others = [donor for donor in errors if donor.log.added_mass.inertia_and_moment != alike]
    return others or list(errors)


def predict_logs(
    logs: Sequence[Log],
    estimate: Estimate,
    setting: Callable[[int, Estimate], Setting],
    *,
    draws: ParameterDraws | None = None,
    errors: Sequence[ExpectedErrors] = (),
    track: Track = untracked,
) -> list[Prediction]:
    """Predict logs from their first sample and their input alone.

    The ``setting`` returns parameters and start of an estimate for a log, by its index. Without
    draws there is no band; without ``errors`` of the fitted logs, none of a new log.
    """
    seeds = np.random.SeedSequence(draws.seed if draws else 0).spawn(len(logs))

    def predicted(number: int) -> Prediction:
        log, best = logs[number], setting(number, estimate)
        simulation = best.simulation(log)
        run = best.run(simulation)
        samples = np.arange(0, log.time.size, max(1, round(_STEP / log.mean_step)))
        bands: dict[str, Band] = {}
        if draws is not None:
            instants = log.time[samples]
            motions: list[Samples] = []
            for draw in draws.estimates(best.horizon):
                if len(motions) >= LEAST and out_of_time("some of the draws"):
                    break
                drawn = setting(number, draw)
                simulated = simulation if simulation.fitted else drawn.simulation(log)
                motion = simulated.run(drawn.parameters, drawn.zero, drawn.velocity)
                motions.append(motion.at(instants))
            angles = np.array(motions)
            bands[OF_PARAMETERS] = _band(angles)
            if errors:
                rng = np.random.default_rng(seeds[number])
                wrong = _drawn_errors(run, samples, errors, len(angles), rng)
                bands[OF_NEW_LOG] = _band(angles + wrong)
        return Prediction(run=run, samples=samples, bands=bands, setting=best)

    return in_threads(predicted, range(len(logs)), track, "Predicting logs")


def _drawn_errors(
    run: FreeRun,
    samples: NDArray[np.intp],
    errors: Sequence[ExpectedErrors],
    count: int,
    rng: np.random.Generator,
) -> Samples:
    """(count, k) errors in rad, each row of one donor, every donor as often as any other."""
    others, time = donors(errors, run.log.added_mass), run.log.time[samples]
    rounds = [rng.permutation(len(others)) for _ in range(-(-count // len(others)))]
    scales = [donor.scale(float(np.std(run.simulated))) for donor in others]
    chosen = np.concatenate(rounds)[:count].tolist()
    return np.array([scales[k] * others[k].drawn(time, rng) for k in chosen])


def _band(angles: Samples) -> Band:
    """Return the quantiles of (m, k) angles."""
    lower, upper = np.quantile(angles, _TAILS, axis=0, method="inverted_cdf")
    return Band(lower=lower, upper=upper)
