"""What the parameters of an identification are made of, as a result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from butterfly.api.tabulated import Tabulated
from butterfly.identification.physical import PhysicalParameters
from butterfly.report.physical import TITLE, physical_numbers, physical_sentences
from butterfly.result import aligned
from butterfly.verdict import Verdict


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Separated(Tabulated):
    """Physical parameters, and what is left open of them."""

    kind: ClassVar[str] = "physical"

    @classmethod
    def of(cls, parameters: PhysicalParameters, name: str, judged: Verdict) -> Separated:
        """Wrap what is told of the robot of some data."""
        return cls(
            title=f"{TITLE} of {name!r}",
            summary=(judged.sentence, *physical_sentences(parameters)),
            table=tuple(
                {"parameter": each} | row for each, row in physical_numbers(parameters).items()
            ),
            judged=judged,
        )

    def shown_lines(self) -> list[str]:
        """Return the table as lines."""
        return aligned(self.shown_rows()) if self.table else []
