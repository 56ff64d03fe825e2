"""Types of arrays, scaling, and rounding."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainSerializer, PlainValidator

Samples = NDArray[np.float64]
"""Numbers; docstrings give their shape."""


def numbers_of(content: Any) -> Samples:  # noqa: ANN401 - whatever is in a file
    """Return the numbers of JSON, where null is NaN; ValueError if they are none."""
    try:
        return np.array(content, dtype=np.float64)
    except TypeError:
        raise ValueError("no numbers") from None


SavedSamples = Annotated[
    Samples, PlainValidator(numbers_of), PlainSerializer(lambda array: array.tolist())
]
"""Numbers that JSON keeps as lists."""

_Number = TypeVar("_Number", bound=np.generic)

BLOCK = 2**12  # rows that are worked on at a time

ROUNDING: float = sys.float_info.epsilon**0.5
"""Share below which a difference is none: half the digits are left to conditioning."""


def unit_columns(rows: Samples) -> tuple[Samples, Samples]:
    """Return (m, n) rows with columns scaled to length 1, and (n,) lengths, 1 instead of 0."""
    size = np.linalg.norm(rows, axis=0)
    size[size == 0] = 1.0
    return rows / size, size


def unit_diagonal(matrix: Samples) -> tuple[Samples, Samples]:
    """Return (n, n) matrices scaled to a diagonal of 1, and (n,) roots of it, 1 instead of 0."""
    size = np.sqrt(np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1), 0.0))
    size[size == 0] = 1.0
    return matrix / (size[..., :, None] * size[..., None, :]), size


def standard_error(values: Samples) -> float:
    """Return the standard error of the mean of (n,) independent values; infinite for one."""
    return float(np.std(values, ddof=1)) / values.size**0.5 if values.size > 1 else math.inf


def blocks(count: int) -> Iterator[slice]:
    """Yield consecutive slices of at most `BLOCK` rows that cover ``count`` rows."""
    for begin in range(0, count, BLOCK):
        yield slice(begin, begin + BLOCK)


def joined(parts: Sequence[NDArray[_Number]]) -> NDArray[_Number]:
    """Return arrays one after the other; a single one itself."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def read_only(numbers: Samples) -> Samples:
    """Return numbers as contiguous ones that nobody may write to.

    Wherever they come from, compiled functions then see one type, and are compiled once.
    """
    seen = np.ascontiguousarray(numbers, dtype=np.float64).view()
    seen.flags.writeable = False
    return seen
