"""Where descents end that started from different first guesses, and the best of these ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from butterfly.errors import IdentifiabilityError
from butterfly.identify.judgement.findings import Finding, FindingKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from butterfly.identify.estimators.equations import Equations
    from butterfly.identify.estimators.free_run_residuals import FreeRunResiduals
    from butterfly.identify.estimators.gauss_newton import Minimum

_ELSEWHERE = 1.05  # ratio of costs, above which two ends are not the same


class Descent(Protocol):
    """What can descend."""

    def descend(
        self, problem: FreeRunResiduals, initial: NDArray[np.float64]
    ) -> Minimum[Equations]:
        """Return where a descent ends."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ends:
    """The best end of some descents.

    Parameters
    ----------
    problem, end
        Its residuals and where it ended.
    findings
        What there is to say of the other ends.
    """

    problem: FreeRunResiduals
    end: Minimum[Equations]
    findings: tuple[Finding, ...]

    @classmethod
    def of(cls, problems: Sequence[FreeRunResiduals], fit: Descent) -> Ends:
        """Descend from the first guess of each problem.

        Raises
        ------
        IdentifiabilityError
            If none of the first guesses can be simulated.
        """
        ends, refusals = [], []
        for problem in problems:
            try:
                ends.append((problem, fit.descend(problem, problem.initial)))
            except IdentifiabilityError as refusal:
                refusals.append(refusal)
        if not ends:
            raise refusals[0]
        (problem, end), *others = sorted(ends, key=lambda each: each[1].at.cost)
        findings = []
        if others and others[0][1].at.cost > _ELSEWHERE * end.at.cost > 0:
            ratio = others[0][1].at.cost / end.at.cost
            findings.append(Finding(kind=FindingKind.OTHER_END, number=ratio))
        return cls(problem=problem, end=end, findings=tuple(findings))
