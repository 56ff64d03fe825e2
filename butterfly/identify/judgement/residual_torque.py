"""The torque that (5) leaves over, tau_eps, and the friction term that it looks like."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from butterfly.identify.weak_signals import Known, weak_signals
from butterfly.model.kinematics import Motion
from butterfly.model.terms import TERMS, FrictionTerms

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from butterfly.logs.log import Log
    from butterfly.model.parameters import LumpedParameters

HALF_WIDTH = 0.05
"""Half-width in s of the bump over which the torque is averaged."""

_SLOW = 0.3  # share of the rms velocity at which Stribeck friction is looked for
_PARTS = ("p1", "p2", "p3", "p4")


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualTorque:
    """tau_eps of one log, averaged over short bumps.

    Parameters
    ----------
    time, angle, velocity, torque
        (n,) instants in s, angle in rad from the hanging position, velocity in rad/s, N m.
    shares
        By term, in words: the part of the torque's variance that this term alone explains, largest
        first.
    """

    time: NDArray[np.float64]
    angle: NDArray[np.float64]
    velocity: NDArray[np.float64]
    torque: NDArray[np.float64]
    shares: dict[str, float]

    @property
    def looks_like(self) -> str:
        """Name the term that explains most."""
        name, share = next(iter(self.shares.items()))
        return f"{name} ({100 * share:.0f} % of its variance)"


def residual_torque(
    log: Log, parameters: LumpedParameters, zero: float, *, half_width: float = HALF_WIDTH
) -> ResidualTorque:
    """Estimate tau_eps = p1 thdd + p2 thd + p3 sin th - p4 v (5), with the added mass put on (78).

    Averaged over a bump phi, the acceleration becomes int phi'' th, so nothing is differentiated
    twice. Friction terms of ``parameters`` are not subtracted: they are what is looked for.

    Parameters
    ----------
    log
        Of any input.
    parameters
        p1..p4 and delay of the bare hand.
    zero
        Encoder reading in rad of the hand at rest.
    half_width
        Of the bump, in s.

    Raises
    ------
    InputError
        If the log is shorter than the bump.
    """
    loaded = parameters.with_added_mass(log.added_mass)
    known = Known(zero=zero, delay=parameters.delay)
    signals = weak_signals(log, _PARTS, known, half_width)
    torque = sum(getattr(loaded, name) * signals.mean[name] for name in _PARTS)
    velocity = signals.velocity
    slow = _SLOW * float(np.sqrt(np.mean(velocity**2)))
    settings = FrictionTerms(stribeck_velocity=slow)
    motion = Motion.of(settings, signals.angle, velocity)
    templates = {
        row.looks_like: signals.mean[row.name] if row.basis is None else row.basis(motion)
        for row in TERMS.values()
        if row.looks_like
    }
    shares = {name: _share(torque, template) for name, template in templates.items()}
    return ResidualTorque(
        time=signals.time,
        angle=signals.angle,
        velocity=velocity,
        torque=torque,
        shares=dict(sorted(shares.items(), key=lambda item: -item[1])),
    )


def _share(torque: NDArray[np.float64], template: NDArray[np.float64]) -> float:
    """Squared correlation of a torque with a template."""
    spread = float(np.std(torque) * np.std(template))
    if spread == 0:
        return 0.0
    return float(np.mean((torque - torque.mean()) * (template - template.mean())) / spread) ** 2
