"""The verdict: whether the values may be used."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from butterfly.identification.diagnostics.findings import Ending, Finding, FindingKind, Severity


class Standing(StrEnum):
    """What may be done with values."""

    GOOD = "good"
    CARE = "use with care"
    NOT = "do not use"

    @property
    def usable(self) -> bool:
        """Whether the values may be used at all."""
        return self is not Standing.NOT

    @classmethod
    def worst(cls, standings: Iterable[Standing]) -> Standing | None:
        """Return the one that allows least; None of none."""
        return max(standings, key=list(cls).index, default=None)


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What may be done with values, and why not more.

    Parameters
    ----------
    standing
        What may be done.
    reasons
        The findings that say so; none for values that are good, or that no solver settled on.
    """

    standing: Standing
    reasons: tuple[Finding, ...] = ()

    @classmethod
    def of(cls, ending: Ending, findings: Sequence[Finding]) -> Verdict:
        """Judge by how an estimation ended, and by the gravest of its findings."""
        warnings, cares = (
            tuple(each for each in findings if each.severity is severity)
            for severity in (Severity.WARNING, Severity.CARE)
        )
        if warnings or ending is not Ending.CONVERGED:
            slips = (each for each in cares if each.kind is FindingKind.SLIP)
            return cls(standing=Standing.NOT, reasons=(*slips, *warnings))
        if cares:
            return cls(standing=Standing.CARE, reasons=cares)
        return cls(standing=Standing.GOOD)

    @property
    def impossible(self) -> bool:
        """Whether no joint has such values, or none that could be simulated."""
        return any(_impossible(each) for each in self.reasons)


def _impossible(finding: Finding) -> bool:
    if finding.kind is FindingKind.POOR_FIT:
        return finding.number is not None and not math.isfinite(finding.number)
    never = finding.kind in {FindingKind.NO_INERTIA, FindingKind.NEGATIVE}
    return never and finding.severity is Severity.WARNING
