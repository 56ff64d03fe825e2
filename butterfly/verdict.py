"""Levels of logs, values and results on one scale, the verdict in words, the level of intervals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from statistics import NormalDist
from typing import Any

CONFIDENCE = 0.95
"""Level of all intervals; tests have a false-alarm rate of 1 less it."""

SPREADS = NormalDist().inv_cdf(0.5 + CONFIDENCE / 2)
"""Half width of an interval, in standard deviations of a normal distribution."""


class Level(StrEnum):
    """How grave a remark is, or the gravest of several."""

    GOOD = "good"
    NOTE = "note"
    CARE = "care"
    WARNING = "warning"

    @property
    def usable(self) -> bool:
        """Whether the values can be used at all."""
        return self is not Level.WARNING

    @property
    def verdict(self) -> str:
        """The level in words: good, use with care, or do not use."""
        return _VERDICTS.get(self, "good")

    @classmethod
    def of_verdict(cls, text: str) -> Level:
        """Return the level of a verdict's text; KeyError for any other text."""
        return {level.verdict: level for level in VERDICTS}[text]

    @classmethod
    def worst(cls, levels: Iterable[Level]) -> Level:
        """Return the gravest; good if there are none."""
        return max(levels, key=list(cls).index, default=cls.GOOD)


VERDICTS = (Level.GOOD, Level.CARE, Level.WARNING)
"""Levels that a verdict can have."""

_VERDICTS = {Level.CARE: "use with care", Level.WARNING: "do not use"}


@dataclass(frozen=True)
class Verdict:
    """The level, and the reasons: a line on the values, then a line on the model."""

    level: Level
    reasons: tuple[str, ...]

    @property
    def lines(self) -> tuple[str, ...]:
        """The reasons as printed; the first line begins with the level."""
        first, *others = self.reasons or ("",)
        return (f"{self.level.verdict.capitalize()}: {first}".removesuffix(": "), *others)

    def after(self, *answer: str) -> tuple[str, ...]:
        """Return the answer to what was asked, then the lines: these first if not to be used."""
        return (*answer, *self.lines) if self.level.usable else (*self.lines, *answer)

    @classmethod
    def of_several(cls, verdicts: Mapping[str, Verdict]) -> Verdict:
        """Return the worst of several verdicts, by name; a line on each other one follows."""
        order = [*Level].index
        (name, worst), *others = sorted(verdicts.items(), key=lambda pair: -order(pair[1].level))
        first, *model = worst.reasons
        rest = (f"{name}: {' '.join(verdict.lines)}" for name, verdict in others)
        return cls(worst.level, (f"{name}: {first}", *model, *rest))

    def numbers(self) -> dict[str, Any]:
        """Return the keys ``verdict`` and ``reasons`` of JSON."""
        return {"verdict": self.level.verdict, "reasons": list(self.reasons)}

    @classmethod
    def of_numbers(cls, content: Mapping[str, Any]) -> Verdict | None:
        """Return the verdict of `numbers`, or None; KeyError, TypeError, ValueError if damaged."""
        if content.get("verdict") is None:
            return None
        reasons = content["reasons"]
        if not (isinstance(reasons, list) and all(isinstance(reason, str) for reason in reasons)):
            raise TypeError("reasons are not all texts")
        return cls(Level.of_verdict(content["verdict"]), tuple(reasons))
