"""What is known of the joint from the runs so far, and how far that is from the goal.

While only one mass was seen the scale is open, and p1 is held at 1: all values are ratios to it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from butterfly.arrays import Samples
from butterfly.campaigns.bench import Bench
from butterfly.campaigns.folder import Folder, Step, log_name
from butterfly.campaigns.guard import Expected
from butterfly.campaigns.laws import LAG
from butterfly.campaigns.plan import least_friction
from butterfly.errors import ButterflyError, IdentifiabilityError
from butterfly.identification.consistency import with_scale
from butterfly.identification.design import OF_GOAL, wanted
from butterfly.identification.identified import Identified
from butterfly.identification.identify import identify
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import Prior
from butterfly.verdict import Level

_BRAKES = 0.5  # of the deceleration that the model gives a brake, which is certain
_LEAST = 1e-9  # of a half-width, that counts as wanted of a value that is 0
_ZERO = 0.5  # rad from where a joint rests, within which it may hang


class Knowledge:
    """What was identified from the runs in a folder, and what follows for the next one."""

    def __init__(
        self,
        bench: Bench,
        folder: Folder,
        goal: float,
        masses: Sequence[AddedMass],
        known: Mapping[str, Any],
    ) -> None:
        self._bench, self._folder, self._goal = bench, folder, goal
        self._several, self._known = len(masses) > 1, known
        self.model: Identified | None = None

    def identify(self) -> None:
        """Identify the joint from all runs so far."""
        self.model = self.identified()

    def expected(self, mass: AddedMass) -> Expected | None:
        """Return what the model says of the joint with a mass; None while there is none."""
        if self.sound is None:
            return None
        loaded, stiffness = self.sound.parameters.with_added_mass(mass), None
        is_known = self.is_known(mass)
        brake = self._bench.braking * loaded.p4 / loaded.p1 if is_known else 0.0
        if is_known and not self._bench.is_loaded_anew:
            stiffness = max(loaded.p3, 0.0) / loaded.p1
        runs = self._folder.journal.steps
        names = [log_name(k) for k, step in enumerate(runs) if step.added_mass == mass]
        home = self._bench.home
        zeros = [self.sound.zeros[name] for name in names if name in self.sound.zeros]
        near = [zero for zero in zeros if abs(zero - home) < _ZERO]  # of this start of the encoder
        return Expected(
            resonance=self._resonance(mass),
            friction=least_friction(self.sound.estimate, mass),
            brake=_BRAKES * brake,
            stiffness=stiffness,
            hanging=near[-1] if near else home,
            delay=max(loaded.delay, 0.0),
        )

    def damping(self, model: Identified, mass: AddedMass, size: float) -> tuple[float, float]:
        """Return speed in rad/s and angle in rad from which a critically damped brake is full."""
        loaded, near = model.parameters.with_added_mass(mass), self._bench.near
        torque = size * loaded.p4
        damping = 2 * math.sqrt(loaded.p1 * max(loaded.p3 + torque / near, 0.0))
        return torque / (damping + LAG * torque / near), near

    def is_known(self, mass: AddedMass) -> bool:
        """Whether the model is of the joint with this mass, too."""
        return not self.is_open or any(e.added_mass == mass for e in self._folder.journal.steps)

    def _resonance(self, mass: AddedMass) -> float:
        """Return the least resonance in rad/s with a mass; with one not used yet an upper bound.

        It lies between that with the last mass and that of what is added, by itself.
        """
        assert self.sound is not None  # noqa: S101 - see `expected`
        last = self._folder.journal.steps[-1].added_mass
        more = np.subtract(mass.inertia_and_moment, last.inertia_and_moment)
        alone = math.sqrt(max(more[1] / more[0], 0.0)) if more[0] > 0 else math.inf
        known = self.is_known(mass)
        estimate, p3 = self.sound.estimate, self.sound.parameters.p3
        lower, _ = estimate.limits_of("p3", p3)
        least = replace(estimate.parameters, p3=max(lower, p3 / 2))  # as little as holds it back
        resonance = resonance_frequency(least.with_added_mass(mass if known else last))
        return resonance if known else max(resonance, alone)

    def identified(self, runs: slice | None = None) -> Identified | None:
        """Identify from all logs so far, or some; None if they do not determine the parameters.

        While the scale is open, p1 is held at 1: all others are ratios to it.
        """
        data, steps = self._folder.data(runs), self._folder.journal.steps
        if self._leaves_open(steps if runs is None else steps[runs]):
            data = data.knowing(Prior.of({"p1": 1.0}))
        try:
            identified = identify(data)
        except ButterflyError:
            return None
        return identified if min(identified.parameters.p1, identified.parameters.p4) > 0 else None

    @property
    def sound(self) -> Identified | None:
        """What was identified, if it may be used."""
        model = self.model
        used = model is not None and model.estimate.level is not Level.WARNING
        return model if used else None

    @property
    def is_open(self) -> bool:
        """Whether the runs so far leave the scale open."""
        return self._leaves_open(self._folder.journal.steps)

    def _leaves_open(self, steps: Sequence[Step]) -> bool:
        """Whether some runs leave the scale open."""
        try:
            with_scale({step.added_mass for step in steps}, Prior.of(self._known))
        except IdentifiabilityError:
            return True
        return False

    def wanted(self, model: Identified) -> Samples:
        """Return (n,) half-widths that the goal asks for."""
        open_ = self.is_open and self._several
        return wanted(model.estimate, model.data.logs, self._goal, scale_open=open_)

    @property
    def shares(self) -> dict[str, float]:
        """Half-widths over those that are wanted, by name."""
        model = self.model
        if model is None:
            return {}
        widths = np.minimum(model.estimate.farther, 1e300)
        shares = widths / np.maximum(self.wanted(model), _LEAST * widths)
        pairs = zip(model.estimate.names, shares.tolist(), strict=True)
        return {name: share for name, share in pairs if name in OF_GOAL}

    @property
    def is_reached(self) -> bool:
        """Whether all half-widths are as wanted, under a verdict *good*."""
        model = self.model
        good = model is not None and model.estimate.level is Level.GOOD
        return good and max(self.shares.values(), default=0.0) <= 1
