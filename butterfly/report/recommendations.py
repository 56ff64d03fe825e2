"""What a ranking of next experiments, or a choice of terms, comes to, in words."""

from __future__ import annotations

from collections.abc import Sequence

from butterfly.identification.design import Candidate
from butterfly.identification.validate import Structure


def most_telling(best: Candidate) -> str:
    """Say which experiment comes first, and what it would leave of the standard errors."""
    warning = f"; but: {best.warning}." if best.warning else "."
    return (
        f"Most telling next: {best.what} with {best.added_mass}, which leaves "
        f"{100 * best.score:.0f} % of the standard errors on average{warning}"
    )


def chosen_said(passed: Sequence[Structure]) -> str:
    """Say which terms were chosen, as an option of other commands."""
    terms = ",".join(passed[-1].terms)
    return f"Chosen: --terms {terms}" if terms else "Chosen: --terms '' (none of them helps)"
