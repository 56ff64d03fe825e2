"""The thesis's method, with the mistakes of its scripts: gains, resonances, p1 to p3.

It reproduces the published digits, and the formulas beside them, for comparison; use harmonic
balance instead. docs/theory.md lists each mistake beside the corrected formula.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import ClassVar, Literal

import numpy as np
from scipy.optimize import least_squares

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.base import Estimator
from butterfly.identification.identified import best_gain
from butterfly.identification.limits import Conditioning
from butterfly.identification.trust import Finding, FindingKind
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import PARAMETERS
from butterfly.signals.frequency_response import periodogram, resample, uniform_grid

UPPER_BOUNDS = (0.10326, 0.02, 4.08096)
"""Upper bounds of p1, p2, p3 in (102), as the script computes them; the lower ones are 0."""

DECIMATION = 25
"""Every 25th sample gives Table 4; every 5th the input of Table 5."""

Weight = Callable[[float, Samples], Samples]

WEIGHTS: dict[str, Weight] = {
    "(84) linear": lambda _, inertia: np.ones(inertia.size),
    "(82) nonlinear": lambda p1, inertia: 1 / (p1 + inertia),
    "(84) orthogonal distance": lambda p1, inertia: 1 / np.hypot(p1, inertia),
}
"""Weights of the equations Y (p1 + Z) = p3 + X of (84), given p1 and (n,) Z.

Linear regression has none, so errors of Y in its regressor shrink p1; over p1 + Z they are those of
(82). Distances (ODRPACK) take errors of Y and Z Y as independent, true abscissae eliminated.
"""

_WINDOW = 30.0
_STARTS = (0.03, 0.3, 0.9)  # shares of the upper bounds from which (102) is minimised
_INSIDE = (1e-9, 0.999)  # shares of them that are on no bound


@dataclass(frozen=True, kw_only=True)
class Thesis(Estimator):
    """p1, p2, p3 from the two largest gains of each added mass, as published, with mistakes.

    It estimates neither Coulomb friction nor delay; p4 maximises the median FIT.

    Parameters
    ----------
    decimation
        Keep every n-th sample: 25 for Table 4, 5 for the input of Table 5.
    """

    method: Literal["thesis"] = "thesis"
    decimation: int = DECIMATION

    summary: ClassVar[str] = "the thesis's fit of resonances, including its mistakes"

    def __post_init__(self) -> None:
        if self.decimation < 1:
            raise InputError(self.method, "decimation", self.decimation, "1 or more")

    def fit(self, data: DataSet) -> tuple[Estimate, None]:
        """Estimate from the sines of a data set; there is no fit to infer anything from."""
        data.require_angles(self.method)
        estimate = fit_thesis(data.recorded, self.decimation)
        values = np.nan_to_num(estimate.values, nan=best_gain(estimate.parameters, data))
        return replace(estimate, values=values), None

    def infer(self, problem: Estimate, fit: None) -> Estimate:  # noqa: ARG002 - as of `Estimator`
        """Return the estimate, as it is."""
        return problem


def scripted_gain(
    coarse: Samples, interval: float, summed: Samples, length: float, size: float
) -> tuple[float, float]:
    """Return the peak's bin in rad/s, and the gain in dB to a sum over length samples.

    As scripted, the bins are those of a record one sample shorter; the centre is (min + max)/2.
    """
    omega, power = periodogram(coarse, interval)
    centred = summed - (coarse.max() + coarse.min()) / 2
    gain = math.sqrt(2 * np.sum(centred**2) / length) / size
    return omega[power.argmax()] * coarse.size / (coarse.size - 1), 20 * math.log10(gain)


def scripted_amplitude(log: Log, decimation: int = DECIMATION) -> tuple[float, float]:
    """Return `scripted_gain` of a log, steps 5 to 8 of the thesis's second script.

    Repeated timestamps are kept, and the gain sums the decimated samples with the undecimated step:
    it is 7 dB low at every 5th sample, 14 dB at every 25th.
    """
    if log.excitation is None:
        raise InputError(log.source, "excitation", "none", "a sine, with omega and amplitude")
    grid = uniform_grid(log.time)
    step = grid[1] - grid[0]
    angle = resample(log.time, log.angle, grid)[::decimation]
    steady = angle[-math.floor(_WINDOW / (decimation * step)) :]
    if steady.size < 2 * decimation:
        expected = f"at least about {_WINDOW:g} s"
        raise InputError(log.source, "time", f"{log.time[-1]:.3g} s", expected)
    size = log.excitation.amplitude
    return scripted_gain(steady, decimation * step, steady, _WINDOW / step, size)


def largest(omega: Samples, gain: Samples) -> tuple[Samples, Samples]:
    """Return the frequencies in rad/s of the two largest gains, and these, the top first (86)."""
    if gain.size < 2:  # noqa: PLR2004
        raise InputError("resonance", "gains", gain.size, "2 or more")
    order = np.argsort(gain)[:-3:-1]
    return omega[order], gain[order]


def between(omega: Samples, gain: Samples, weight: Callable[[Samples], Samples]) -> float:
    """Return the resonance in rad/s by (90): weights of the squares, each by the other's gain g.

    Printed: sqrt(g^2 + A), A = |G(w_opt)|^2; right: sqrt(A - g^2); exact: sqrt(1/g^2 - 1/A).
    """
    w, g = largest(omega, gain)
    shares = weight(g)[::-1]
    return math.sqrt(float(shares @ w**2 / shares.sum()))


def by_100(omega: Samples, gain: Samples) -> float:
    """Return the resonance in rad/s by (100), which the scripts give the gains in dB."""
    return between(omega, gain, lambda two: np.hypot(two, two[0]))


def parabola(omega: Samples, gain: Samples, curvature: float) -> float:
    """Return the resonance in rad/s by (89): |G|^2 = A - B (w^2 - w_opt^2)^2, B the curvature."""
    w, g = largest(omega, gain)
    x, y = w**2, g**2
    return math.sqrt(max(x.mean() + (y[0] - y[1]) / (x[0] - x[1]) / (2 * curvature), 0.0))


def regression(squares: Samples, masses: Sequence[AddedMass], weight: Weight) -> Samples:
    """Return p1 in kg m^2, p3 in N m by (n,) squared resonances Y in rad^2/s^2 and `WEIGHTS`."""
    inertia, moment = np.array([(m.inertia, m.gravity_moment) for m in masses]).T
    rows = np.column_stack([-squares, np.ones(squares.size)])
    start = np.linalg.lstsq(rows, squares * inertia - moment)[0]

    def errors(values: Samples) -> Samples:
        residuals = squares * (values[0] + inertia) - values[1] - moment
        return np.asarray(residuals * weight(values[0], inertia))

    return np.asarray(least_squares(errors, start, x_scale=np.abs(start), gtol=1e-14).x)


def fit_resonances(
    resonances: Mapping[AddedMass, float],
    upper: Sequence[float] = UPPER_BOUNDS,
    *,
    p2: float | None = None,
) -> tuple[Samples, Samples]:
    """Minimise (102) over 0 <= p1, p2, p3 <= upper, from several starts.

    Table 5 is not this minimum: the script's optimiser stopped before. Returns p1, p2, p3 and
    the (m, 3) Jacobian of the residuals there; `p2` in N m s/rad is fixed if given.
    """
    measured = np.square(list(resonances.values()))
    inertia, moment = np.array([(m.inertia, m.gravity_moment) for m in resonances]).T

    def values(shares: Samples) -> Samples:
        p1, damping, p3 = shares * upper
        return np.array([p1, damping if p2 is None else p2, p3])

    def residuals(shares: Samples) -> Samples:
        p1, damping, p3 = values(shares)
        loaded = p1 + inertia
        return np.asarray((p3 + moment) / loaded - 0.5 * (damping / loaded) ** 2 - measured)

    tight = {"bounds": (0, 1), "xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}
    fits = (least_squares(residuals, start, **tight) for start in product(_STARTS, repeat=3))
    best = min(fits, key=lambda fit: fit.cost)
    return values(best.x), best.jac / upper


def fit_thesis(logs: Sequence[Log], decimation: int = DECIMATION) -> Estimate:
    """Resonance of each mass by (100), then p1, p2, p3 by (102), of raw logs; p4 is NaN."""
    resonances = {}
    for mass in sorted({log.added_mass for log in logs}):
        group = [log for log in logs if log.added_mass == mass]
        if len(group) < 2:  # noqa: PLR2004 - (100) takes the two largest gains
            raise InputError(group[0].source, "logs", f"only one log with {mass}", "two or more")
        resonances[mass] = by_100(*np.array([scripted_amplitude(x, decimation) for x in group]).T)
    fitted, jacobian = fit_resonances(resonances)
    values, unknown = np.array([*fitted, np.nan, 0.0, 0.0]), np.full(len(PARAMETERS), np.nan)
    conditioning = Conditioning.of(jacobian, PARAMETERS[:3])
    shares = zip(PARAMETERS[:3], fitted / UPPER_BOUNDS, strict=True)
    on_bound = tuple(name for name, share in shares if not _INSIDE[0] <= share <= _INSIDE[1])
    return Estimate(
        method="thesis",
        names=PARAMETERS,
        values=values,
        covariance=np.full((values.size, values.size), np.nan),
        lower=unknown,
        upper=unknown,
        condition=conditioning.number,
        on_bound=on_bound,
        findings=(
            Finding(FindingKind.NOT_ESTIMATED, PARAMETERS[3:]),
            Finding(FindingKind.NO_UNCERTAINTY, PARAMETERS[:3], number=len(resonances)),
            *conditioning.findings,
            *([Finding(FindingKind.PULLED, on_bound)] if on_bound else []),
        ),
        resonances=resonances,
    )
