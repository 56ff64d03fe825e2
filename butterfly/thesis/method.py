"""The thesis's method as its scripts compute it, including their mistakes.

It reproduces the published digits for comparison; use harmonic balance instead. docs/theory.md
lists each mistake beside the corrected formula.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import ClassVar, Literal

import numpy as np
from scipy.optimize import least_squares

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimators.base import Estimator
from butterfly.identification.findings import Finding, FindingKind
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.inference.identifiability import Conditioning
from butterfly.identification.parameters_by_hand import best_gain
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import PARAMETERS
from butterfly.signals.spectrum import periodogram, resample, uniform_grid

UPPER_BOUNDS = (0.10326, 0.02, 4.08096)
"""Upper bounds of p1, p2, p3 in (102), as the script computes them; the lower ones are 0."""

DECIMATION = 25
"""Every 25th sample gives Table 4; every 5th the input of Table 5."""

_WINDOW = 30.0
_STARTS = (0.03, 0.3, 0.9)  # shares of the upper bounds from which (102) is minimised
_UNESTIMATED = ("coulomb", "delay", "p4")


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

    def __call__(self, data: DataSet) -> Estimate:
        """Estimate from the sines of a data set (see `Estimator`)."""
        data.require_angles(self.method)
        found = fit_thesis(data.recorded, self.decimation)
        return found.with_gain(best_gain(found.parameters, data))


@dataclass(frozen=True)
class ScriptedAmplitude:
    """The script's result of one log: the bin of the peak in rad/s, and the gain in dB."""

    omega: float
    gain_db: float


def scripted_amplitude(log: Log, decimation: int = DECIMATION) -> ScriptedAmplitude:
    """Dominant DFT bin and gain of a log, steps 5 to 8 of the thesis's second script.

    As scripted: repeated timestamps are kept; the bin frequencies are those of a record one sample
    shorter; the centre is (min + max)/2; the gain sums the decimated samples with the undecimated
    step (7 dB low at every 5th sample, 14 dB at every 25th) and is in dB.
    """
    if log.excitation is None:
        raise InputError(log.source, "excitation", "none", "a sine, with omega and amplitude")
    grid = uniform_grid(log.time)
    step = grid[1] - grid[0]
    angle = resample(log.time, log.angle, grid)[::decimation]
    steady = angle[-math.floor(_WINDOW / (decimation * step)) :]
    if steady.size < 2 * decimation:
        raise InputError(
            log.source, "time", f"{log.time[-1]:.3g} s", f"at least about {_WINDOW:g} s"
        )
    omega, power = periodogram(steady, decimation * step)
    omega = omega * steady.size / (steady.size - 1)
    centred = steady - (steady.max() + steady.min()) / 2
    amplitude = math.sqrt(2 * np.sum(centred**2) * step / _WINDOW)
    return ScriptedAmplitude(
        omega=float(omega[np.argmax(power)]),
        gain_db=20 * math.log10(amplitude / log.excitation.amplitude),
    )


def scripted_resonance(first: ScriptedAmplitude, second: ScriptedAmplitude) -> float:
    """Resonance frequency in rad/s from the two largest gains (100), with the gains in dB."""
    alpha = math.sqrt((second.gain_db / first.gain_db) ** 2 + 1)
    beta = math.sqrt(2)
    return math.sqrt((first.omega**2 * alpha + second.omega**2 * beta) / (alpha + beta))


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
    bounds = np.asarray(upper, dtype=np.float64)

    def residuals(shares: Samples) -> Samples:
        p1, damping, p3 = shares * bounds
        if p2 is not None:
            damping = p2
        inertia = p1 + np.array([mass.inertia for mass in resonances])
        moment = p3 + np.array([mass.gravity_moment for mass in resonances])
        return np.asarray(moment / inertia - 0.5 * (damping / inertia) ** 2 - measured)

    fits = [
        least_squares(residuals, start, bounds=(0, 1), xtol=1e-15, ftol=1e-15, gtol=1e-15)
        for start in product(_STARTS, repeat=3)
    ]
    best = min(fits, key=lambda fit: fit.cost)
    values = best.x * bounds
    if p2 is not None:
        values[1] = p2
    return values, best.jac / bounds


def fit_thesis(logs: Sequence[Log], decimation: int = DECIMATION) -> Estimate:
    """Resonance of each mass by (100), then p1, p2, p3 by (102), of raw logs; p4 is NaN."""
    groups: dict[AddedMass, list[Log]] = {}
    for log in logs:
        groups.setdefault(log.added_mass, []).append(log)
    resonances = {}
    for mass in sorted(groups):
        if len(groups[mass]) < 2:  # noqa: PLR2004 - (100) takes the two largest gains
            raise InputError(
                groups[mass][0].source, "logs", f"only one log with {mass}", "two or more"
            )
        points = [scripted_amplitude(log, decimation) for log in groups[mass]]
        second, first = sorted(points, key=lambda point: point.gain_db)[-2:]
        resonances[mass] = scripted_resonance(first, second)
    fitted, jacobian = fit_resonances(resonances)
    values = np.array([*fitted, np.nan, 0.0, 0.0])
    unknown = np.full(values.size, np.nan)
    conditioning = Conditioning.of(jacobian, PARAMETERS[:3])
    shares = fitted / UPPER_BOUNDS
    on_bound = tuple(
        name
        for name, share in zip(PARAMETERS[:3], shares, strict=True)
        if share > 0.999 or share < 1e-9  # noqa: PLR2004
    )
    findings = [
        Finding(FindingKind.NOT_ESTIMATED, _UNESTIMATED),
        Finding(FindingKind.NO_UNCERTAINTY, PARAMETERS[:3], number=len(resonances)),
        *conditioning.findings,
    ]
    if on_bound:
        findings.append(Finding(FindingKind.PULLED, on_bound))
    return Estimate(
        method="thesis",
        names=PARAMETERS,
        values=values,
        covariance=np.full((values.size, values.size), np.nan),
        lower=unknown,
        upper=unknown,
        condition=conditioning.number,
        on_bound=on_bound,
        findings=tuple(findings),
        resonances=resonances,
    )
