"""One division of logs into blocks of time, for whatever takes or leaves out a part of a log.

Errors are alike within a log, so that what counts as independent is a log, or where there are few
of them a tenth of one.
"""

from __future__ import annotations

PER_LOG = 10
"""Blocks of a log, where there are too few logs."""

FEW = 3
"""Logs up to which their scatter tells nothing of that between others."""


def cells(logs: int) -> int:
    """Return into how many blocks of time each of some logs is divided."""
    return PER_LOG if logs <= FEW else 1
