"""What a campaign reports while it moves a joint, and to whom."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from butterfly.campaigns.folder import Journal
from butterfly.campaigns.guard import Limits
from butterfly.campaigns.laws import RESERVE
from butterfly.logs.log import InputKind
from butterfly.model.parameters import AddedMass
from butterfly.plant.motor import Reading


class CampaignCallbacks:
    """Is called at each phase and each cycle; this one does nothing. Any method may be replaced.

    What a method raises ends the campaign, with the drive off.
    """

    def begin(self, announcement: Sequence[str]) -> None:
        """Take what will be played, the limits and how to stop it, before the first motion."""

    def phase(self, sentence: str) -> None:
        """Take a sentence on what begins now and why, or on what came of it."""

    def cycle(self, reading: Reading, command: float) -> None:
        """Take a reading, and the command that was set after it."""


def announcement(
    limits: Limits,
    kind: InputKind,
    journal: Journal | None,
    *,
    goal: float,
    masses: Sequence[AddedMass],
    folder: Path,
) -> list[str]:
    """Return what will be played, for what and within which limits; ``journal``: of a former part.

    ``goal`` is a share of the values; ``folder`` is where runs are kept.
    """
    within = [f"command {limits.command:g} {kind.unit}", f"angle {limits.angle:g} rad from rest"]
    within += [f"speed {limits.speed:g} rad/s"] * math.isfinite(limits.speed)
    within += [f"current {limits.current:g} A"] * math.isfinite(limits.current)
    begins = "begins with small pushes either way, then plays"
    steps = () if journal is None else journal.steps
    if journal is not None:
        begins = f"continues after {len(steps)} run{'s' if len(steps) != 1 else ''}: it plays"
    budget = limits.seconds - (steps[-1].seconds if steps else 0.0)
    with_masses = f", with {' and '.join(map(str, masses))}" if len(masses) > 1 else ""
    return [
        f"Goal: parameters known to {100 * goal:.3g} %{with_masses}; runs are kept in {folder}.",
        f"The campaign {begins} swings of at most {RESERVE * limits.angle:.2g} rad, each followed "
        f"by a pause with the drive off; {budget:.0f} s of robot time at most.",
        f"Limits: {', '.join(within)}. Beyond one of them the joint is braked, then the drive "
        "switched off.",
    ]


def time_left(budget: float, remaining: float) -> str:
    """Return how much of the robot time is left in s, and what the plan still needs, if known."""
    if math.isnan(remaining):
        return f"{budget:.0f} s of robot time left."
    return f"About {remaining:.0f} s of robot time to the goal; {budget:.0f} s left."
