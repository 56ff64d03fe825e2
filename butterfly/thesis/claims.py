"""A figure, and what is said of it beside what is seen in it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from butterfly.arrays import Samples
from butterfly.files import replacing

CLOSE = 0.01
"""Share of a number that is negligible beside it."""


class Claim(NamedTuple):
    """What is said of a figure, beside what is seen in it, and whether that agrees."""

    text: str
    holds: bool


def near(what: str, said: float, seen: float, unit: str = "", within: float = 0.0) -> Claim:
    """Compare two numbers: they agree ``within`` a bound, or if what is between is negligible."""
    holds = abs(seen - said) <= max(within, CLOSE * abs(said))
    return Claim(f"{what} {said:.4g}{unit} (here {seen:.4g}{unit})", bool(holds))


class Curve(NamedTuple):
    """Two columns, each a name with its unit and (n,) numbers, drawn against each other."""

    look: Literal["line", "dots", "circles", "crosses"]
    columns: Mapping[str, Samples]


@dataclass(frozen=True, eq=False)
class ThesisFigure:
    """Curves by their names in the legend, how they are drawn, and claims on them."""

    name: str  # of its files
    title: str
    axes: tuple[str, str]
    curves: Mapping[str, Curve]
    claims: Sequence[Claim]
    marks: Mapping[str, float] = field(default_factory=dict)  # abscissae that are printed
    logarithmic: str = ""  # axes, of "xy"
    shown: tuple[float, float] | None = None  # part of the first axis that is drawn

    @property
    def sentence(self) -> str:
        """What agrees and what does not."""
        parts = []
        for how, holds in (("Agrees", True), ("Does not", False)):
            some = "; ".join(claim.text for claim in self.claims if claim.holds == holds)
            parts += [f"{how}: {some}."] if some else []
        return " ".join(parts)

    def write(self, folder: Path) -> None:
        """Write all columns as ``folder``/NAME.csv."""
        columns = {k: v for each in self.curves.values() for k, v in each.columns.items()}
        with replacing(folder / f"{self.name}.csv") as draft:
            rows = list(zip_longest(*columns.values(), fillvalue=math.nan))
            header = ",".join(columns)
            np.savetxt(draft, rows, fmt="%.9g", delimiter=",", header=header, comments="")


def digits(values: Iterable[float]) -> str:
    """Return numbers as the thesis prints them."""
    return " ".join(f"{value:.4f}" for value in values)
