"""How a file was read, where it is not as the project writes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What was made of a file.

    Parameters
    ----------
    layout
        What its text is like, in words: delimiters, decimal commas, lines that are no samples.
    cut_lines
        Last lines that were cut off in writing, and dropped.
    units
        Units, other than the project's, that the file itself gives to its columns, by the log's
        field, and that were used.
    """

    layout: tuple[str, ...] = ()
    cut_lines: int = 0
    units: Mapping[str, str] = field(default_factory=dict)


AS_WRITTEN = Reading()
"""Of a file as the project writes it, and of a log from no file."""
