"""First contact with an unknown joint: which way it turns, and what it takes to move it."""

from __future__ import annotations

from typing import NamedTuple

from butterfly.campaigns.bench import Bench
from butterfly.campaigns.drive import SafetyStop
from butterfly.campaigns.laws import LAG, RESERVE, Push

ENOUGH = 8e-3
"""Rad by which the joint has to move."""

_FIRST = 1e-3  # share of the largest command, at which a push begins
_NOISES = 10.0  # standard deviations of the encoder's noise that count as motion
_LONGEST = 10.0  # s of a push, from the first command to the largest


class Contact(NamedTuple):
    """What first contact showed."""

    polarity: int  # 1, or -1 where a positive command turns towards negative angles
    breakaway: float  # command that moves the joint, the larger of both directions


def make_contact(bench: Bench) -> Contact:
    """Push either way with a growing command until the joint moves; `SafetyStop` if it does not."""
    most, pushes = RESERVE * bench.limits.command, list[Push]()
    for side in (1, -1):
        bench.settle()
        enough = max(ENOUGH, _NOISES * bench.noise)
        push = Push(bench.rest, enough, side * _FIRST * most, most)
        cut = bench.run(push, _LONGEST, RESERVE * bench.limits.angle).cut
        if cut:
            raise SafetyStop(
                f"{cut} before the joint has moved by {enough:.2g} rad: check the drive"
            )
        if abs(push.moved) < enough:
            raise SafetyStop(
                f"nothing moves at a command of {push.command:g}, {RESERVE:.0%} of the largest "
                "allowed: check supply, enable, brake, and the encoder's cable"
            )
        if side > 0:
            bench.polarity = 1 if push.moved > 0 else -1
            bench.braked_with(push.command, enough / max(push.took, LAG))
        elif push.moved > 0:
            raise SafetyStop(
                "both signs of the command move the joint the same way: check the drive's "
                "direction input, and that its command has a sign"
            )
        pushes.append(push)
    bench.guard.stood = max(push.took for push in pushes)
    return Contact(bench.polarity, max(abs(push.command) for push in pushes))
