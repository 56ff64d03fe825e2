"""Where descents end that started from different first guesses, and the best of these ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import IdentifiabilityError
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.estimators.equations import Equations
from butterfly.identification.estimators.free_run_residuals import FreeRunResiduals
from butterfly.identification.estimators.gauss_newton import Minimum

_ELSEWHERE = 1.05  # ratio of costs, above which two ends are not the same
_GLANCE = 8  # passes after which a descent that is not lower than another is given up


class Descent(Protocol):
    """What can descend."""

    def descend(
        self,
        problem: FreeRunResiduals,
        initial: NDArray[np.float64],
        known: Equations | None = None,
        most: int = ...,
    ) -> Minimum[Equations]:
        """Return where a descent ends."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ends:
    """The best end of some descents."""

    problem: FreeRunResiduals  # problem, end: its residuals and where it ended
    end: Minimum[Equations]
    findings: tuple[Finding, ...]  # what there is to say of the other ends

    @classmethod
    def of(cls, problems: Sequence[FreeRunResiduals], fit: Descent) -> Ends:
        """Descend from the first guess of each problem.

        The first descent is made to its end; the others are, only where they come lower.
        """
        ends: list[_End] = []
        refusals = []
        for problem in problems:
            try:
                ends.append(_descended(problem, fit, ends))
            except IdentifiabilityError as refusal:
                refusals.append(refusal)
        if not ends:
            raise refusals[0]
        (problem, end), *others = sorted(ends, key=_cost)
        ratios = [_cost(each) / end.at.cost for each in others if each.end.converged]
        elsewhere = [ratio for ratio in ratios if ratio > _ELSEWHERE]
        findings = tuple(
            Finding(kind=FindingKind.OTHER_END, number=min(elsewhere)) for _ in elsewhere[:1]
        )
        return cls(problem=problem, end=end, findings=findings)


class _End(NamedTuple):
    problem: FreeRunResiduals
    end: Minimum[Equations]


def _cost(each: _End) -> float:
    return each.end.at.cost


def _descended(problem: FreeRunResiduals, fit: Descent, before: Sequence[_End]) -> _End:
    """Descend to the end, or so far that it shows that the end is no better than one before."""
    if not before:
        return _End(problem, fit.descend(problem, problem.initial))
    least = min(map(_cost, before))
    end = fit.descend(problem, problem.initial, most=_GLANCE)
    if not end.converged and end.at.cost < least:
        end = fit.descend(problem, end.point, end.at)
    return _End(problem, end)
