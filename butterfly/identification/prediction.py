"""What a joint will do under a given input, and how far that is known: two bands about a free run.

The band of the parameters holds the motion of the model, with whatever parameters the estimate
leaves open. The band of a new log holds a recording: to each draw of the parameters come the errors
of a log that the model has not seen (see `expected_errors`). Both are pointwise,
at `butterfly.identification.inference.intervals.CONFIDENCE`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.draws import ParameterDraws
from butterfly.identification.estimate import Estimate
from butterfly.identification.expected_errors import LeftOver, donors
from butterfly.identification.free_run import Trajectory
from butterfly.identification.inference.intervals import CONFIDENCE
from butterfly.identification.predict import FreeRun, Setting, free_run
from butterfly.identification.segments import Segments
from butterfly.logs.log import Log
from butterfly.progress import Track, untracked

Samples = NDArray[np.float64]
SettingOf = Callable[[int, Estimate], Setting]

OF_PARAMETERS = "parameters"
OF_NEW_LOG = "new log"
"""What the two bands are of."""

_STEP = 0.02  # s, between the samples at which a band is worked out
_TAILS = ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class Band:
    """(m,) angles in rad, between which (m,) angles are expected."""

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
    """A log predicted.

    Parameters
    ----------
    run
        Its free run with the estimate.
    samples
        (m,) numbers of the samples at which the bands are.
    bands
        `OF_PARAMETERS` and `OF_NEW_LOG`, as far as there are any.
    """

    run: FreeRun
    samples: NDArray[np.intp]
    bands: dict[str, Band]

    @property
    def time(self) -> Samples:
        """(m,) stamps in s of the bands."""
        return self.run.log.time[self.samples]

    @property
    def measured(self) -> Samples:
        """(m,) measured angles in rad where the bands are."""
        return self.run.log.angle[self.samples]


def predict_logs(
    logs: Sequence[Log],
    estimate: Estimate,
    setting: SettingOf,
    *,
    draws: ParameterDraws | None = None,
    errors: Sequence[LeftOver] = (),
    seed: int = 0,
    track: Track = untracked,
) -> list[Prediction]:
    """Predict logs from their first sample and their input alone.

    Parameters
    ----------
    logs
        Of which the first sample and the input count.
    estimate
        Of the parameters.
    setting
        Says with what an estimate simulates a log, by its number.
    draws
        Of the parameters; without them there is no band.
    errors
        Of the logs that the estimate was made from; without them there is no band of a new log.
    seed
        Fixes which of them are drawn.
    track
        Shows progress.
    """
    seeds = np.random.SeedSequence(seed).spawn(len(logs))

    def predicted(number: int) -> Prediction:
        log, own = logs[number], setting(number, estimate)
        run = free_run(log, own)
        samples = np.arange(0, log.time.size, max(1, round(_STEP / log.mean_step)))
        bands: dict[str, Band] = {}
        if draws is not None:
            drawn = [setting(number, each) for each in draws.estimates()]
            angles = _angles(own.simulation(log), log.time[samples], drawn)
            bands[OF_PARAMETERS] = _band(angles, draws.weights)
            if errors:
                rng = np.random.default_rng(seeds[number])
                angles += _drawn_errors(run, samples, errors, len(drawn), rng)
                bands[OF_NEW_LOG] = _band(angles, draws.weights)
        return Prediction(run=run, samples=samples, bands=bands)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(track(pool.map(predicted, range(len(logs))), "Predicting logs"))


def _angles(course: Trajectory | Segments, time: Samples, settings: Sequence[Setting]) -> Samples:
    """(m, k) angles in rad of m simulations of one log, at (k,) instants in s."""
    angles = [course.at(time, each.parameters, each.zero, each.velocity) for each in settings]
    return np.array(angles)


def _drawn_errors(
    run: FreeRun,
    samples: NDArray[np.intp],
    errors: Sequence[LeftOver],
    count: int,
    rng: np.random.Generator,
) -> Samples:
    """(count, k) errors in rad, each row of one donor, every donor as often as any other."""
    others, time = donors(errors, run.log.added_mass), run.log.time[samples]
    rounds = [rng.permutation(len(others)) for _ in range(-(-count // len(others)))]
    drawn = np.array([others[k].drawn(time, rng) for k in np.concatenate(rounds)[:count]])
    return float(np.std(run.simulated)) * drawn


def _band(angles: Samples, weights: Samples) -> Band:
    """Return the quantiles of (m, k) angles by their (m,) weights."""
    order = np.argsort(angles, axis=0)
    reached = np.cumsum(weights[order], axis=0)
    rows = (np.argmax(reached >= tail * reached[-1], axis=0) for tail in _TAILS)
    lower, upper = (
        np.take_along_axis(angles, np.take_along_axis(order, row[None], axis=0), axis=0)[0]
        for row in rows
    )
    return Band(lower=lower, upper=upper)
