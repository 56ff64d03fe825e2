"""Angles that fall back by a turn where the joint goes on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_TURN = 2 * math.pi
_NEAR = math.pi / 2  # rad by which a jump may miss a turn, as the joint goes on meanwhile
_SLACK = 0.05  # rad by which it may miss it at rest
_BLURRED = 0.1  # other large steps for each jump, of a log whose jumps stand out no more
_WHOLE = 0.75  # share of the span that a jump by an unknown turn takes, at least
_SMALL = 0.25  # share of it that all other steps stay below
_SWEPT = 0.5  # share of it that the joint passes between two jumps, at least once
_BACK = 0.75  # share of the jumps that go against the motion, at least
_BESIDE = 3  # steps on either side of a jump that show the motion, or bring an outlier back
_SNAP = 0.002  # by which an encoder's turn may miss a whole share or multiple of the joint's


@dataclass(frozen=True)
class Wrapping:
    """Jumps of an angle by a turn of its encoder."""

    turn: float  # rad
    exact: bool  # a whole share or multiple of the joint's turn; else measured, and drifts
    rows: NDArray[np.intp]  # (n,) numbers of the samples before them


def find_wrapping(angle: NDArray[np.float64], gap: NDArray[np.bool_]) -> Wrapping | None:
    """Find where an (n,) angle in rad jumps by a turn; None if nowhere.

    The turn is 2 pi, or several of these as of a counter that starts again, if jumps of this size
    stand out from all other steps. Else it is any size by which the angle jumps at least twice from
    one end of its span to the other, against the motion, and never otherwise comes near such a
    step. An outlier, which comes back, is no jump. ``gap``: (n - 1,) intervals that say nothing of
    the motion between their ends.
    """
    steps = np.diff(angle)
    span = float(np.ptp(angle))
    if float(max(steps.max(), -steps.min())) < min(_TURN - _NEAR, _WHOLE * span):
        return None
    sizes = np.abs(steps)
    known = np.where(gap, 0.0, steps)
    turn = _whole_turns(known) or _encoders_turn(angle, known, span)
    if turn is None:
        return None
    ratio = round(turn / _TURN) or 1 / round(_TURN / turn)
    exact = abs(turn / (_TURN * ratio) - 1.0) < _SNAP
    turn = _TURN * ratio if exact else turn
    return Wrapping(turn, exact, np.flatnonzero(np.abs(sizes - turn) < 0.25 * turn))


def unwrapped(angle: NDArray[np.float64], wrapping: Wrapping) -> NDArray[np.float64]:
    """Return the (n,) angle that goes on beyond its turns."""
    jumps = np.zeros(angle.size)
    rows = wrapping.rows
    jumps[rows + 1] = wrapping.turn * np.sign(angle[rows] - angle[rows + 1])
    return np.asarray(angle + np.cumsum(jumps))


def _whole_turns(steps: NDArray[np.float64]) -> float | None:
    """Return 2 pi, or several, if steps of this size stand out."""
    sizes = np.abs(steps)
    large = sizes > _TURN - _NEAR
    if not large.any():
        return None
    turn = _TURN * round(float(np.median(sizes[large])) / _TURN)
    jump = np.abs(sizes - turn) < _NEAR
    others = sizes[~jump]
    if not jump.any() or not others.size:
        return None
    blurred = np.count_nonzero(others > _NEAR) > _BLURRED * np.count_nonzero(jump)
    usual = float(others[others <= _NEAR].max(initial=0.0))
    fits = np.abs(sizes[jump] - turn) <= 2.0 * usual + _SLACK
    lasting = turn == _TURN or not _comes_back(np.sign(steps) * jump)
    return turn if lasting and not blurred and fits.any() else None


def _comes_back(jumps: NDArray[np.float64]) -> bool:
    """Whether each jump, 1 or -1 among zeros, is undone soon after."""
    rows = np.flatnonzero(jumps)
    pairs = zip(rows[::2], rows[1::2], strict=False)
    undone = [jumps[i] == -jumps[j] and j - i <= _BESIDE for i, j in pairs]
    return rows.size % 2 == 0 and all(undone)


def _encoders_turn(
    angle: NDArray[np.float64], steps: NDArray[np.float64], span: float
) -> float | None:
    """Return the turn of an encoder that does not sit on the joint, or counts otherwise."""
    sizes = np.abs(steps)
    rows = np.flatnonzero(sizes >= _WHOLE * span)
    others = np.delete(sizes, rows)
    if rows.size < 2 or not others.size or others.max() > _SMALL * span:  # noqa: PLR2004
        return None
    pieces = np.split(angle, rows + 1)
    if max(float(np.ptp(piece)) for piece in pieces) < _SWEPT * span:
        return None
    beside = rows[:, None] + np.setdiff1d(np.arange(-_BESIDE, _BESIDE + 1), [0])
    near = steps[np.clip(beside, 0, steps.size - 1)]
    motion = np.median(np.where(np.abs(near) >= _WHOLE * span, 0.0, near), axis=1)
    if np.mean(motion * steps[rows] < 0) < _BACK:
        return None
    return float(np.mean(sizes[rows] + np.abs(motion)))
