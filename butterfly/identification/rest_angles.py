"""About which angle each sine's swing goes, and what that says of a constant torque.

The mean torque of gravity at a swing of amplitude a about th0 is (p3 + X) J0(a) sin th0, and a
constant torque is all that it can be in balance with. So the middles of the swings with different
added masses, and of different amplitudes, tell the bias from the encoder's zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import j0

from butterfly.identification.inference.submodels import Nested
from butterfly.identification.inference.term_choice import choose_terms, folds_of
from butterfly.identification.solved import Solved
from butterfly.identification.zeros import doubts
from butterfly.model.known import Known
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.signals.frequency_response import ResponsePoint

Samples = NDArray[np.float64]

_EXACT = Known(value=0.0)
_NAMES = ("zero", "bias")
_NEGLIGIBLE = 1e-6  # rad
_SETTLED = 0.1  # of what the middles leave over


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
    # (n,) measured less foretold middles in rad, where there is a bias
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
        """Read them off steady responses.

        ``points``: the n responses; ``parameters``: of the bare hand, as far as they are known;
        ``zeros``: rest angle in rad for each added mass; ``told``: what is told of the zeros of the
        responses, in rad; nothing if not given; ``asked``: whether a bias is wanted; if None, it is
        if it helps to foretell the middles with masses that were left out.
        """
        moments = np.array([p.added_mass.gravity_moment for p in points])
        stiffness = (parameters.p3 + moments) * j0([p.amplitude for p in points])
        usable = bool((stiffness > 0).all())
        given = told or [None] * len(points)
        own = cls(
            middles=np.array([p.angle.offset for p in points]),
            masses=tuple(p.added_mass for p in points),
            told=np.array([zero is not None for zero in given]),
            uncertain=doubts([zero or _EXACT for zero in given]),
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
        if asked is False or not usable:
            return own
        return own.with_bias(asked=asked is True)

    def applied(self, parameters: LumpedParameters) -> LumpedParameters:
        """Return parameters with the bias."""
        return replace(parameters, bias=self._known)

    def moved(self, simulated: Samples) -> RestAngles:
        """Return them so that a model whose swings went about (n,) middles follows the logs."""
        if self.bias is None:
            return self
        left = self.middles - simulated
        zero, bias = _solved(self._rows, left)
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
        return bool(np.abs(moved).max() <= max(_SETTLED * float(np.std(self.left)), _NEGLIGIBLE))

    def of_part(self, kept: NDArray[np.bool_]) -> float:
        """Return the bias that some logs tell, by a mask."""
        return self._known + float(_solved(self._rows[kept], self.left[kept])[1])

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
    def solved(self) -> Solved:
        """The bias, with the zero eliminated, and the equations about it."""
        freedom = max(self.left.size - len(self._names), 1)
        scale = float(np.sqrt(np.sum(self.left**2) / freedom)) or 1.0
        open_ = ~self.told
        middle = self.compliance[open_].mean() if open_.any() else 0.0
        row = self.compliance - middle * open_
        return Solved(
            names=("bias",),
            values=np.array([self._known]),
            jacobian=row[:, None] / scale,
            residuals=-self.left / scale,
            cluster=np.arange(self.left.size),
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
        """Return them with one zero and a bias, if that is asked for or foretells the middles."""
        rows = self._rows
        target = self.middles - self.zeros * self.told
        values = _solved(rows, target)
        count = self.zeros.size
        kept = [_NAMES.index(name) for name in self._names]
        nested = Nested.of(
            rows[:, kept].reshape(count, 1, len(kept)),
            (rows @ values - target).reshape(count, 1),
            names=self._names,
            values=values[kept],
            lower=np.full(len(kept), -np.inf),
            folds=folds_of(self.masses),
        )
        nested = replace(nested, negligible=_NEGLIGIBLE)
        always = self._names[:-1]
        chosen = choose_terms([nested], always=always, demanded=("bias",) if asked else ())
        if "bias" not in chosen.terms:
            return self
        zeros = np.where(self.told, self.zeros, values[0])
        left = target - rows @ values
        return replace(self, zeros=zeros, bias=float(values[1]), left=left)


def _solved(rows: Samples, target: Samples) -> Samples:
    return np.asarray(np.linalg.lstsq(rows, target, rcond=None)[0], dtype=np.float64)
