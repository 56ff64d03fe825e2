"""Which sines have settled, about which angles they swing, and how the model itself responds.

The mean torque of gravity at a swing of amplitude a about th0 is (p3 + X) J0(a) sin th0, and a
constant torque is all that it can be in balance with. So the middles of the swings with different
added masses, and of different amplitudes, tell the bias from the encoder's zero.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import j0

from butterfly.arrays import Samples
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.encoder_offset import offset_errors
from butterfly.identification.equations import CellEquations
from butterfly.identification.estimators.harmonic_balance_regression import (
    HarmonicBalanceFit,
    Phasors,
)
from butterfly.identification.inference.term_choice import NEGLIGIBLE, choose_terms, submodels_of
from butterfly.identification.levels import LOST, PRECISE
from butterfly.identification.simulation import Simulation
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.prior import Known
from butterfly.model.terms import TERMS
from butterfly.signals.frequency_response import ResponsePoint

_EXACT = Known(value=0.0)
_NAMES = ("zero", "bias")

LARGEST_SINE = math.pi / 2
"""In rad, beyond which the steady response to a sine is no sine any more, even nearly."""
_ELSEWHERE = LARGEST_SINE / 2  # rad between the middle of a swing and the rest angle

_ROUNDS, _ROUNDS_OF_BIAS = 3, 8  # of correcting phasors by what simulations leave over


@dataclass(frozen=True, kw_only=True, eq=False)
class RestAngles:
    """Where n logs would rest."""

    middles: Samples  # (n,) of the swings, encoder readings in rad
    masses: tuple[AddedMass, ...]
    # (n,) whether the zero is told, so that the middle tells of the bias alone
    told: NDArray[np.bool_]
    # (k, n) standard uncertainties in rad of k independent errors of the zeros that are told
    uncertain: Samples
    compliance: Samples  # (n,) by which a torque moves the middle, in rad/(N m)
    zeros: Samples  # (n,) encoder readings in rad where the model's angle is 0
    # in N m; None where the middles do not tell of one, and each mass has a zero of its own
    bias: float | None = None
    # (n,) measured less predicted middles in rad, where there is a bias
    left: Samples = field(default_factory=lambda: np.empty(0))

    @classmethod
    def of(
        cls,
        points: Sequence[ResponsePoint],
        parameters: LumpedParameters,
        zeros: Mapping[AddedMass, float],
        *,
        asked: bool | None,
        told: Sequence[Known | None] = (),
    ) -> RestAngles:
        """Read them off steady responses."""
        moments = np.array([p.added_mass.gravity_moment for p in points])
        stiffness = (parameters.p3 + moments) * j0([p.amplitude for p in points])
        usable = bool((stiffness > 0).all())
        given = told or [None] * len(points)
        own = cls(
            middles=np.array([p.angle.offset for p in points]),
            masses=tuple(p.added_mass for p in points),
            told=np.array([zero is not None for zero in given]),
            uncertain=offset_errors([zero or _EXACT for zero in given]),
            compliance=1 / stiffness if usable else np.ones(moments.size),
            zeros=np.array(
                [
                    zeros[p.added_mass] if zero is None else zero.value
                    for p, zero in zip(points, given, strict=True)
                ]
            ),
        )
        turns = np.round((own.middles - own.zeros) / (2 * np.pi))
        own = replace(own, middles=own.middles - 2 * np.pi * turns)
        return own if asked is False or not usable else own.with_bias(asked=asked is True)

    def moved(self, simulated: Samples) -> RestAngles:
        """Return them so that a model whose swings went about (n,) middles follows the logs."""
        if self.bias is None:
            return self
        left = self.middles - simulated
        zero, bias = np.linalg.lstsq(self._rows, left, rcond=None)[0]
        return replace(
            self,
            zeros=self.zeros + zero * ~self.told,
            bias=self._known + float(bias),
            left=left - self._rows @ np.array([zero, bias]),
        )

    def near(self, other: RestAngles) -> bool:
        """Whether a bias is where another has it, by little of its errors."""
        if self.bias is None or other.bias is None:
            return True
        moved = self.compliance * (self.bias - other.bias) + self.zeros - other.zeros
        return bool(np.abs(moved).max() <= max(PRECISE * float(np.std(self.left)), NEGLIGIBLE))

    @property
    def shared_zero(self) -> dict[AddedMass | str | None, dict[str, float]]:
        """The encoder's zero in rad that was found beside a bias, as an estimate holds it."""
        found = self.zeros[~self.told]
        return {None: {"zero": float(found[0])}} if found.size else {}

    @property
    def variance_by_zeros(self) -> float:
        """What the errors of zeros that are told add to the bias's variance, in (N m)^2."""
        moved = self.uncertain @ np.linalg.pinv(self._rows)[1]
        return float(moved @ moved)

    @property
    def solved(self) -> CellEquations:
        """The bias, with the zero eliminated, and the equations about it."""
        freedom = max(self.left.size - len(self._names), 1)
        scale = float(np.sqrt(np.sum(self.left**2) / freedom)) or 1.0
        open_ = ~self.told
        middle = self.compliance[open_].mean() if open_.any() else 0.0
        row = self.compliance - middle * open_
        return CellEquations(
            names=("bias",),
            values=np.array([self._known]),
            rows=row[:, None, None] / scale,
            residuals=-self.left[:, None] / scale,
            log=np.arange(self.left.size),
            on_bound=np.zeros(1, dtype=bool),
            lower=np.full(1, -np.inf),
        )

    @property
    def _names(self) -> tuple[str, ...]:
        """What the middles tell: the encoder's zero where it is not told, and the bias."""
        return _NAMES[1:] if self.told.all() else _NAMES

    @property
    def _known(self) -> float:
        return self.bias or 0.0

    @property
    def _rows(self) -> Samples:
        return np.column_stack([~self.told, self.compliance])

    def with_bias(self, *, asked: bool) -> RestAngles:
        """Return them with one zero and a bias, if that is asked for or predicts the middles."""
        rows = self._rows
        target = self.middles - self.zeros * self.told
        values = np.asarray(np.linalg.lstsq(rows, target, rcond=None)[0], dtype=np.float64)
        count = self.zeros.size
        kept = [_NAMES.index(name) for name in self._names]
        equations = CellEquations(
            names=self._names,
            values=values[kept],
            lower=np.full(len(kept), -np.inf),
            on_bound=np.zeros(len(kept), dtype=bool),
            rows=rows[:, None, kept],
            residuals=(rows @ values - target)[:, None],
            log=np.arange(count),
        )
        nested = submodels_of(equations, self.masses, NEGLIGIBLE)
        always = self._names[:-1]
        chosen = choose_terms([nested], always=always, demanded=("bias",) if asked else ())
        if "bias" not in chosen.terms:
            return self
        zeros = np.where(self.told, self.zeros, values[0])
        left = target - rows @ values
        return replace(self, zeros=zeros, bias=float(values[1]), left=left)


def steady_sines(data: DataSet) -> tuple[list[int], list[Finding]]:
    """Return the numbers of the logs whose response to a sine is steady, and what of the others."""
    sines = [k for k, point in enumerate(data.points) if point is not None]
    steady = [k for k in sines if _is_steady(data, k)]
    lost = [k for k in sines if k not in steady]
    names = tuple(data.logs[k].name for k in lost)
    return steady, [Finding(FindingKind.LEFT_OUT, number=len(sines), logs=names)] if lost else []


def _is_steady(data: DataSet, number: int) -> bool:
    point = data.points[number]
    assert point is not None  # noqa: S101 - of a sine
    log, swing = data.logs[number], point.amplitude
    away = math.remainder(point.angle.offset - data.zero_of(log), 2 * math.pi)
    widest = float(np.ptp(log.angle)) / 2
    return (
        0 < swing <= LARGEST_SINE
        and widest <= math.pi / 2 + LARGEST_SINE
        and not point.angle.residual_rms * math.sqrt(2) > LOST * swing
        and not abs(point.drift) > LOST
        and (abs(away) < _ELSEWHERE or not data.hangs)
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class SteadyModel:
    """What is simulated besides a balance's parameters: sines, and the angles they go about."""

    simulations: Sequence[Simulation]
    rest: RestAngles
    poles: Sequence[complex | None]  # of the transients that were fitted to them

    def corrected(self, fit: HarmonicBalanceFit) -> tuple[HarmonicBalanceFit, SteadyModel]:
        """Return the fit with what the model's own motion leaves over, if it is near."""
        parameters = replace(fit.parameters, bias=self.rest.bias or 0.0)
        masses = (each.log.added_mass for each in self.simulations)
        if not parameters.p1 + min(mass.inertia for mass in masses) > 0:
            return fit, self
        logs = zip(self.simulations, self.rest.zeros.tolist(), self.poles, strict=True)
        responses = (each.steady_response(parameters, *own) for each, *own in logs)
        moved, middles = zip(*responses, strict=True)
        phasors = _with_remainder(fit, np.array(moved))
        rest = self.rest.moved(np.array(middles)) if np.isfinite(middles).all() else self.rest
        return HarmonicBalanceFit.of(phasors), replace(self, rest=rest)

    def settled(self, fit: HarmonicBalanceFit) -> tuple[HarmonicBalanceFit, SteadyModel]:
        """Correct a fit until one more correction would move it by little of its errors."""
        robot, last = self, 1.0
        for _ in range(_ROUNDS if self.rest.bias is None else _ROUNDS_OF_BIAS):
            before, rest = fit, robot.rest
            fit, robot = robot.corrected(fit)
            moved = fit.moved_to(before)
            still = robot.rest.near(rest)
            if still and moved * min(moved / last, 1.0) < PRECISE:  # about what the next moves
                break
            last = moved
        return fit, robot


def _with_remainder(fit: HarmonicBalanceFit, moved: NDArray[np.complex128]) -> Phasors:
    """Return the balance with what a model's motion, (n,) simulated phasors in rad, leaves over."""
    phasors, measured = fit.phasors, fit.phasors.angle
    size = np.abs(moved) / np.abs(measured)
    told = np.isfinite(size) & (size > LOST) & (size < 1 / LOST)
    moved = np.where(told, moved, measured)
    none = np.zeros_like(phasors.remainder)
    model = replace(phasors, angle=moved, swing=np.abs(moved), remainder=none)
    matrix, target = model.equations(fit.parameters)
    values = [0.0 if TERMS[n].of_gain else getattr(fit.parameters, n) for n in phasors.names]
    return replace(phasors, remainder=np.where(told, matrix @ np.array(values) - target, 0.0))
