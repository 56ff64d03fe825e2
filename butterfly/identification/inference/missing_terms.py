"""Terms that a fit does not have, though they would help it.

The choice of terms finds them: no other test of them is made. They are named, and intervals include
what they would move, where sensors do not explain the errors of the free runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.findings import Finding, FindingKind
from butterfly.identification.fit import Missing
from butterfly.identification.inference.stagewise import is_near
from butterfly.logs.log import Log
from butterfly.model.parameters import value_if_absent
from butterfly.model.terms import PARAMETERS


@dataclass(frozen=True, kw_only=True, eq=False)
class MissingTerms:
    """Terms that are not fitted and that improve the prediction of held-out logs."""

    terms: tuple[str, ...] = ()
    others: tuple[tuple[str, ...], ...] = ()  # sets of as many that predict as well
    share: float = 0.0  # of the squared residuals that they explain
    shares: Mapping[str, float] = field(default_factory=dict)  # the same of each log, by its name
    moved: tuple[str, ...] = ()  # parameters that they move by more than their intervals allow
    rival: Samples | None = None  # (n,) values with them, if they move any so far

    @classmethod
    def of(
        cls,
        missing: Sequence[Missing],
        here: Mapping[str, float],
        half: Samples,
        logs: Sequence[Log],
    ) -> MissingTerms:
        """Return what a choice from n values found to be missing.

        ``here``: the values, by name, with (n,) half-widths.
        """
        if not missing:
            return cls()
        best, *others = missing
        there = {name: best.values.get(name, value_if_absent(name)) for name in here}
        far = np.abs(np.subtract([*there.values()], [*here.values()])) > half
        moved = tuple(n for n, is_far in zip(here, far, strict=True) if is_far and n in PARAMETERS)
        near = is_near(there, here, [log.added_mass for log in logs])
        return cls(
            terms=(best.name,),
            others=tuple((each.name,) for each in others),
            share=best.share,
            shares=dict(zip((log.name for log in logs), best.shares.tolist(), strict=True)),
            moved=moved,
            rival=np.array([*there.values()]) if moved and near else None,
        )

    @property
    def names(self) -> str:
        """Names of the terms and of their alternatives."""
        return " or ".join(" + ".join(each) for each in (self.terms, *self.others) if each)

    @property
    def findings(self) -> list[Finding]:
        """The finding that names them, and the parameters that they move; none without terms."""
        if not self.terms:
            return []
        return [Finding(FindingKind.MISSING_TERM, (self.names, *self.moved), number=self.share)]

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        return asdict(self) | {"rival": None if self.rival is None else self.rival.tolist()}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any] | None) -> MissingTerms:
        """Return that of a `to_dict`, or none; KeyError, TypeError or ValueError if damaged."""
        if content is None:
            return cls()
        rival = content["rival"]
        return cls(
            terms=tuple(map(str, content["terms"])),
            others=tuple(tuple(map(str, each)) for each in content["others"]),
            share=float(content["share"]),
            shares={str(name): float(each) for name, each in content["shares"].items()},
            moved=tuple(map(str, content["moved"])),
            rival=None if rival is None else np.array(rival, dtype=np.float64),
        )
