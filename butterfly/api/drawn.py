"""Parameters that an identification leaves open, as a file and as models."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path
from typing import ClassVar

from butterfly.files import replacing
from butterfly.identification.draws import ParameterDraws
from butterfly.identification.identification import Identification
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.result import Answer

WEIGHT = "weight"
"""Column that says how much a draw counts, 1 on average."""

_FIELDS = [each.name for each in fields(LumpedParameters)]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Drawn(Answer):
    """Sets of parameters of the bare hand in SI units, a row each, and their weights."""

    kind: ClassVar[str] = "draws"

    @classmethod
    def of(cls, draws: ParameterDraws, found: Identification, said: Sequence[str]) -> Drawn:
        """Tabulate draws from an identification, with what is to be said of them."""
        estimate, count = draws.estimate, len(draws.values)
        columns = [*estimate.names, *(key for key in estimate.fixed if key not in estimate.names)]
        rows = zip(draws.parameters, draws.weights.tolist(), strict=True)
        units = {row["parameter"]: row["unit"] for row in found.rows()}
        return cls(
            title=f"{count} draws of the parameters of {found.title}",
            summary=(found.judged.sentence, *said, *found.verdict[1:]),
            judged=found.judged,
            units={f"rows.{name}": unit for name, unit in units.items()},
            content={
                "rows": [
                    {**{key: getattr(each, key) for key in columns}, WEIGHT: count * weight}
                    for each, weight in rows
                ]
            },
        )

    @property
    def parameters(self) -> list[LumpedParameters]:
        """Each draw as parameters of the bare hand."""
        return [
            LumpedParameters(**{key: value for key, value in row.items() if key in _FIELDS})
            for row in self.rows()
        ]

    def write_csv(self, path: str | PathLike[str]) -> None:
        """Write the table as CSV: names of parameters in the first line, SI units, and `WEIGHT`.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        with (
            replacing(Path(path)) as draft,
            draft.open("w", newline="", encoding="utf-8") as file,
        ):
            writer = csv.DictWriter(file, list(self.rows()[0]))
            writer.writeheader()
            writer.writerows(self.rows())

    def models(
        self,
        added_mass: AddedMass = NO_ADDED_MASS,
        *,
        mass: float | None = None,
        bristle_stiffness: float = 0.0,
    ) -> Iterator[str]:
        """Yield an MJCF model of each draw, which plain MuJoCo loads, for domain randomisation.

        Parameters
        ----------
        added_mass, mass, bristle_stiffness
            See `butterfly.plant.stand_alone.models`.

        Raises
        ------
        InputError
            If no hand of that mass moves so, or MuJoCo has no such friction.
        """
        from butterfly.plant.stand_alone import models  # noqa: PLC0415 - slow to import

        return models(self.parameters, added_mass, mass=mass, bristle_stiffness=bristle_stiffness)
