"""A figure, and claims about it against the data that it shows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

from butterfly.arrays import Samples
from butterfly.files import write_file

CLOSE = 0.01
"""Relative difference up to which two numbers agree."""


class Claim(NamedTuple):
    """A statement on a figure, with the number obtained here, and whether they agree."""

    text: str
    holds: bool


def near(what: str, expected: float, seen: float, unit: str = "", within: float = 0.0) -> Claim:
    """Compare a number with the expected one: they agree ``within`` a bound, or up to 1 %."""
    holds = abs(seen - expected) <= max(within, CLOSE * abs(expected))
    return Claim(f"{what} {expected:.4g}{unit} (here {seen:.4g}{unit})", bool(holds))


@dataclass(frozen=True, eq=False)
class ThesisFigure:
    """Curves by their names in the legend, how they are drawn, and claims on them."""

    name: str  # of its files
    title: str
    axes: tuple[str, str]
    # a look (line, dots, circles or crosses), and two columns of (n,) values by name and unit
    curves: Mapping[str, tuple[str, Mapping[str, Samples]]]
    claims: Sequence[Claim]
    marks: Mapping[str, float] = field(default_factory=dict)  # abscissae that are printed
    logarithmic: str = ""  # axes, of "xy"
    shown: tuple[float, float] | None = None  # part of the first axis that is drawn
    about: str = ""  # what it shows

    @property
    def sentence(self) -> str:
        """What agrees and what does not."""
        parts = []
        for how, holds in (("Agrees", True), ("Does not agree", False)):
            some = "; ".join(claim.text for claim in self.claims if claim.holds == holds)
            parts += [f"{how}: {some}."] if some else []
        return " ".join(parts)

    @property
    def columns(self) -> dict[str, Samples]:
        """All columns by name."""
        return {k: v for _, columns in self.curves.values() for k, v in columns.items()}

    def write(self, folder: Path) -> None:
        """Write all columns as ``folder``/NAME.csv."""
        columns = self.columns
        texts = ([x if isinstance(x, str) else f"{x:.9g}" for x in v] for v in columns.values())
        rows = [[*columns], *zip_longest(*texts, fillvalue="nan"), [""]]
        write_file(folder / f"{self.name}.csv", "\n".join(map(",".join, rows)))


def digits(values: Iterable[float]) -> str:
    """Return numbers as the thesis prints them."""
    return " ".join(f"{value:.4f}" for value in values)
