"""How far a value can be trusted: one scale for the verdict, badges, words and programs.

A value's half-width h is the distance of its farther limit. Within `PRECISE` of the value it is
good; *precise* is a definite statement, made where `CLEARLY` times the half-width is within it, as
if half-widths were standard errors. The rows, the first that holds:

| row | claim in JSON | badge | holds if |
|---|---|---|---|
| KNOWN | known | known | it was given exactly |
| OPEN | open | open | its data give a limit alone |
| AT_BOUND | as without the bound | at bound | it is on an active bound |
| UNSURE | "" | "" | it has no interval |
| ZERO | not-from-zero | may be 0 | the interval includes 0 |
| UNREAD | unit-unread | care | precise, by a unit that a finding doubts |
| PRECISE | precise | good | 3.3 h' <= 10 % of the value, h' half of the interval |
| GOOD | rough | good | h <= 10 % of the value |
| CARE | rough | care | 3.3 h <= the value |
| POOR | rough | poor | else |
"""

from __future__ import annotations

import math
from enum import Enum

from butterfly.identification.levels import CLEARLY
from butterfly.verdict import Level

PRECISE = 0.1
"""Relative half-width within which a value is good."""


class Trust(Enum):
    """A row: the claim that programs read, the badge, and how grave that is (None: no badge)."""

    KNOWN = "known", "known", Level.NOTE
    OPEN = "open", "open", Level.CARE
    AT_BOUND = "", "at bound", Level.CARE
    UNSURE = "", "", None
    ZERO = "not-from-zero", "may be 0", Level.CARE
    UNREAD = "unit-unread", "care", Level.CARE
    PRECISE = "precise", "good", Level.GOOD
    GOOD = "rough", "good", Level.GOOD
    CARE = "rough", "care", Level.CARE
    POOR = "rough", "poor", Level.WARNING

    def __init__(self, claim: str, badge: str, level: Level | None) -> None:
        self.claim, self.badge, self.level = claim, badge, level

    @property
    def sized(self) -> bool:
        """Whether it has an interval that excludes 0."""
        return self in {Trust.PRECISE, Trust.UNREAD, Trust.GOOD, Trust.CARE, Trust.POOR}


def trust_of(
    value: float | None,
    lower: float,
    upper: float,
    *,
    known: bool = False,
    on_bound: bool = False,
    doubted: bool = False,
) -> Trust:
    """Return the row of a value, None if it is open, with its limits and what is found of it.

    ``doubted``: Whether a finding doubts its unit.
    """
    if known or value is None:
        return Trust.KNOWN if known else Trust.OPEN
    if on_bound:
        return Trust.AT_BOUND
    if not (math.isfinite(lower) and math.isfinite(upper)):
        return Trust.UNSURE
    half, farther, size = (upper - lower) / 2, max(upper - value, value - lower), abs(value)
    rows = {
        Trust.ZERO: lower <= 0 <= upper,
        Trust.UNREAD if doubted else Trust.PRECISE: CLEARLY * half <= PRECISE * size,
        Trust.GOOD: farther <= PRECISE * size,
        Trust.CARE: CLEARLY * farther <= size,
    }
    return next((row for row, holds in rows.items() if holds), Trust.POOR)
