"""A verdict in words, as it stands first on every page, in every table and result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from butterfly.identification.diagnostics.verdict import Standing

_NOTHING = "nothing was found that speaks against these values."


@dataclass(frozen=True)
class SaidVerdict:
    """What may be done with values, and why not more, in sentences.

    Parameters
    ----------
    standing
        What may be done.
    reasons
        Why not more, and what to do about it; none for values that are good.
    """

    standing: Standing
    reasons: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """All of it in one line."""
        return f"{self.standing.capitalize()}: {' '.join(self.reasons) or _NOTHING}"

    @property
    def paragraphs(self) -> list[str]:
        """The reasons, each to stand alone."""
        return list(self.reasons) or [_NOTHING.capitalize()]

    def numbers(self) -> dict[str, Any]:
        """Return it as JSON has it: the standing under ``verdict``, and the ``reasons``."""
        return {"verdict": str(self.standing), "reasons": list(self.reasons)}

    @classmethod
    def of_numbers(cls, content: Mapping[str, Any]) -> SaidVerdict | None:
        """Return what `numbers` told of; None where there is no verdict.

        Raises
        ------
        KeyError, TypeError, ValueError
            If something is missing, or not what it should be.
        """
        if content.get("verdict") is None:
            return None
        reasons = content["reasons"]
        if not (isinstance(reasons, list) and all(isinstance(each, str) for each in reasons)):
            raise TypeError("reasons that are no texts")
        return cls(Standing(content["verdict"]), tuple(reasons))
