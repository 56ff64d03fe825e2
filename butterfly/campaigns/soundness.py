"""Whether a run is sound, before it is fitted: it rests where it did, and with the mass it says."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from butterfly.arrays import Samples
from butterfly.campaigns.contact import ENOUGH
from butterfly.campaigns.drive import SafetyStop
from butterfly.campaigns.folder import Step
from butterfly.identification.identified import Identified
from butterfly.identification.parameter import MATTERS
from butterfly.identification.repeatability import Contradiction, contradiction_text
from butterfly.model.parameters import AddedMass

_SLIPS = 2.0  # widths of the band in which friction holds a joint, within which it may rest


class Rests:
    """Where the joint rests with each mass."""

    def __init__(self) -> None:
        self._first: dict[AddedMass, float] = {}  # angle in rad of the first rest

    def take(self, mass: AddedMass, rest: float) -> None:
        """Take where the joint rested with a mass, in rad, in a former session."""
        self._first.setdefault(mass, rest)

    def require_no_slip(self, rest: float, mass: AddedMass, model: Identified | None) -> None:
        """Raise `SafetyStop` if the joint rests where gravity and friction do not let it.

        ``rest`` in rad; without a usable model, any rest is accepted.
        """
        first = self._first.setdefault(mass, rest)
        if model is None:
            return
        estimate = model.estimate
        least, _ = estimate.limits_of("p3", estimate.parameters.p3)
        loaded = replace(estimate.parameters, p3=least).with_added_mass(mass)
        _, most = estimate.limits_of("coulomb", loaded.coulomb)
        width = 2 * most / loaded.p3 if loaded.p3 > 0 else math.inf
        if abs(rest - first) > _SLIPS * width + ENOUGH:
            raise SafetyStop(
                f"the joint rests {abs(rest - first):.3g} rad from its first rest position, but "
                f"friction explains only {width:.2g} rad: the encoder slips or has another zero, "
                "or the mount moved; put it back, or begin in a new folder"
            )


def require_changed(
    before: Identified | None, old: Step, new: Step, alone: Callable[[], Identified | None]
) -> None:
    """Raise `SafetyStop` if the first run after a change of mass shows the joint as it was.

    ``before``: what was identified before the ``new`` run; ``alone``: identifies from that run.
    Ratios to the inertia are compared. Where the scale is known, a mass that should change them by
    too little to be seen passes.
    """
    if before is None or old.added_mass == new.added_mass:
        return
    was = _ratios(before, old)
    expected = _ratios(before, new) if "p1" in before.estimate.names else math.inf
    if np.max(np.abs(expected / was - 1)) < 2 * MATTERS or (model := alone()) is None:
        return
    if np.max(np.abs(_ratios(model, new) / was - 1)) <= MATTERS:
        raise SafetyStop(
            f"the joint moves as it did with {old.added_mass}: {new.added_mass} is not mounted, or "
            "is too small for this joint to make a difference"
        )


def require_repeated(contradiction: Contradiction | None) -> None:
    """Raise `SafetyStop` where two runs of one mass contradict each other."""
    if contradiction is not None:
        raise SafetyStop(contradiction_text(contradiction.finding))


def _ratios(model: Identified, step: Step) -> Samples:
    """Return (2,) gravity moment and gain over the inertia, with the mass of a run."""
    loaded = model.parameters.with_added_mass(step.added_mass)
    return np.array([loaded.p3, loaded.p4]) / loaded.p1
