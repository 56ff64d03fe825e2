"""One scale for how much speaks against a log, a value or a result, and the verdict in words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class Level(StrEnum):
    """How much speaks against something: of a single remark, or the worst of many."""

    GOOD = "good"
    NOTE = "note"
    CARE = "care"
    WARNING = "warning"

    @property
    def usable(self) -> bool:
        """Whether the values may be used at all."""
        return self is not Level.WARNING

    @property
    def verdict(self) -> str:
        """What may be done with values: good, use with care, or do not use."""
        return _VERDICTS.get(self, "good")

    @classmethod
    def of_verdict(cls, text: str) -> Level:
        """Return the level of a verdict's text; KeyError if it is none."""
        return {each.verdict: each for each in VERDICTS}[text]

    @classmethod
    def worst(cls, levels: Iterable[Level]) -> Level:
        """Return the one that allows least; of none, that all is well."""
        return max(levels, key=list(cls).index, default=cls.GOOD)


VERDICTS = (Level.GOOD, Level.CARE, Level.WARNING)
"""What a verdict on values can be."""

_VERDICTS = {Level.CARE: "use with care", Level.WARNING: "do not use"}


@dataclass(frozen=True)
class Verdict:
    """What may be done with values, and the lines that say why: the values, then the model."""

    level: Level
    reasons: tuple[str, ...]

    @property
    def lines(self) -> tuple[str, ...]:
        """What is printed: the first line begins with what may be done."""
        first, *others = self.reasons or ("",)
        return (f"{self.level.verdict.capitalize()}: {first}".removesuffix(": "), *others)

    @classmethod
    def of_several(cls, verdicts: Mapping[str, Verdict]) -> Verdict:
        """Return the worst of some by name, with the lines of all."""
        reasons = (f"{name}: {line}" for name, each in verdicts.items() for line in each.reasons)
        return cls(Level.worst(each.level for each in verdicts.values()), tuple(reasons))

    def numbers(self) -> dict[str, Any]:
        """Return it as JSON has it: what may be done under ``verdict``, and the ``reasons``."""
        return {"verdict": self.level.verdict, "reasons": list(self.reasons)}

    @classmethod
    def of_numbers(cls, content: Mapping[str, Any]) -> Verdict | None:
        """Return the verdict of `numbers`; None where there is none.

        KeyError, TypeError or ValueError if something is missing, or not what it should be.
        """
        if content.get("verdict") is None:
            return None
        reasons = content["reasons"]
        if not (isinstance(reasons, list) and all(isinstance(each, str) for each in reasons)):
            raise TypeError("reasons that are no texts")
        return cls(Level.of_verdict(content["verdict"]), tuple(reasons))
