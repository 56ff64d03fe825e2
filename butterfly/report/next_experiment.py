"""What a ranking of next experiments comes to, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from butterfly.identify.design import Candidate


def most_telling(best: Candidate) -> str:
    """Say which experiment comes first, and what it would leave of the standard errors."""
    warning = f"; but: {best.warning}." if best.warning else "."
    return (
        f"Most telling next: {best.what} with {best.added_mass}, which leaves "
        f"{100 * best.score:.0f} % of the standard errors on average{warning}"
    )
