"""Where a log contradicts itself, or what any joint can do: a text and what to check, or None."""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from butterfly.arrays import Samples
from butterfly.logs.faults import at_speed, resolution_of
from butterfly.logs.log import Log

_GRID = 2**14  # samples that are looked at, at most
_LADDER = (16, 32, 64, 128, 256)  # windows that a log is divided into, as its pace is unknown
_LEAST = 8  # samples of a window, and windows of a law
_FASTEST = 5e3  # rad/s: no joint turns at 48,000 revolutions a minute
_BY = 4.0  # resolutions by which a joint moves
_PARTS = 6  # windows of a stuck angle, and of what was before,
_TRIED, _MOVED = 4, 3  # and how many of either have excursions of the input, at least
_WIDE, _ALIKE = 0.25, 1.1  # share of its range that they take; how much larger is no larger
_STEADY = 0.8  # of the usual motion, below which it died away before it stopped
_RARELY = 0.1  # share of the windows in which a joint that moves on may rest
_SCALE = 10.0  # factor from which a column has another scale
_HOLDS = 0.85  # share of the input that a law explains where it holds, at least,
_FAILS, _CHANCE = 0.05, 10.0  # and where it fails, at most, but for chance over the windows
_NOISE, _NOISY = 1.2, 2.5  # of noise: squared steps over variance; resolutions that it spans
_TINY = 1e-300
_REST = "but the rest of the log is unchanged"
_UNIT = "Check the unit of the {0} (--units {0}=...), and that the whole log has the same."


def find_contradiction(log: Log) -> tuple[str, str] | None:
    """Return a contradiction in a log of finite values and increasing time, and what to check."""
    time = np.linspace(log.time[0], log.time[-1], min(log.time.size, _GRID))
    inputs, angle = (np.interp(time, log.time, column) for column in (log.input, log.angle))
    length = max(time.size // _LADDER[-1], 1)
    speed = np.abs(angle[length:] - angle[:-length]) / (time[length] - time[0])
    if speed.max() > _FASTEST:
        since, fast = time[np.argmax(speed > _FASTEST)], speed.max()
        most = f"{fast:.2g} {log.added_mass.joint.way}/s"
        text = f"from {since:.4g} s on the joint moves at up to {most}, faster than any joint"
        if np.quantile(speed, 1 - _RARELY) > _FASTEST:  # not at a fault of the encoder alone
            return text, "Check the units of angle and time (--units angle=..., --units time=...)."
        return text, "Check the encoder there, or leave that part out (--from, --to)."
    contradiction = _stuck(log, time, inputs, angle) or _rescaled(log, time, inputs, angle)
    return contradiction or _unreached(log, inputs, angle)


def _stuck(log: Log, time: Samples, inputs: Samples, angle: Samples) -> tuple[str, str] | None:
    """Find an angle that stops in the midst of motion under an input that moved it before."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(log.angle)) + 1, [log.time.size]])
    longest = int(np.argmax(log.time[edges[1:] - 1] - log.time[edges[:-1]]))
    row, ends = edges[longest], log.time[[edges[longest], edges[longest + 1] - 1]]
    low, high = np.searchsorted(time, ends)
    if (length := int(min(high - low, low)) // _PARTS) < _LEAST:
        return None
    tried = np.sort(_efforts(inputs[low:high], length), axis=0)[-_TRIED]
    efforts, moved = _efforts(inputs[:low], length), np.ptp(_cut(angle[:low], length), axis=1)
    wide, least = _WIDE * np.ptp(inputs), resolution_of(log.angle)
    by = moved[(efforts <= _ALIKE * tried).all(axis=1) & (efforts[:, 0] >= wide)]
    drop = np.abs(log.angle[:row] - log.angle[row])[::-1]
    running = moved[-1] >= _STEADY * np.median(moved) or at_speed(drop, least, moved[-1])
    if tried[0] <= wide or by.size < _MOVED or by.min() < _BY * least or not running:
        return None
    text = f"from {ends[0]:.4g} to {ends[1]:.4g} s the angle is constant while the input goes on"
    return text, "Check the encoder, and whether the joint was blocked."


def _efforts(inputs: Samples, length: int) -> Samples:
    """Return (m, 3) efforts: range and peak of the input, and how far it would throw a mass."""
    cut = _cut(inputs, length)
    thrown = np.cumsum(np.cumsum(cut - cut.mean(axis=1, keepdims=True), axis=1), axis=1)
    return np.column_stack([np.ptp(cut, axis=1), np.abs(cut).max(axis=1), np.ptp(thrown, axis=1)])


def _cut(column: Samples, length: int) -> Samples:
    """Return (m, length) windows that overlap by half."""
    return sliding_window_view(column, length)[:: max(length // 2, 1)]


def _rescaled(log: Log, time: Samples, inputs: Samples, angle: Samples) -> tuple[str, str] | None:
    """Find a column whose scale jumps while the law of one part, but for it, holds in the other."""
    (jump, row), name = max((_change(inputs), "input"), (_change(angle), "angle"))
    parts = [_cut(part, time.size // _LADDER[0]) for part in np.split(angle, [row])]
    moved = min(np.median(np.ptp(part, axis=1)) for part in parts)
    if jump < math.log(_SCALE) or moved < _BY * resolution_of(log.angle):
        return None
    for length in [time.size // count for count in _LADDER]:
        laws = [_law(inputs[part], angle[part], length) for part in (slice(row), slice(row, None))]
        for law, other in (laws, laws[::-1]):
            share, factor = _told(law, other)
            holds = min(share, _told(law, law)[0]) > _HOLDS
            if holds and max(factor, 1.0 / factor) > _SCALE:
                factor = factor if (law is laws[0]) == (name == "input") else 1.0 / factor
                text = f"from {time[row]:.4g} s on the {name} is about {float(f'{factor:.1g}'):g} "
                return f"{text}times as large, {_REST}", _UNIT.format(name)
    return None


def _change(column: Samples) -> tuple[float, int]:
    """Return the logarithm by which a column's mean square changes, and where it likeliest does."""
    edge, sums = column.size // _LADDER[0], np.cumsum(column**2)
    count = np.arange(edge, column.size - edge)
    early = np.log(np.maximum(sums[count - 1], _TINY) / count)
    late = np.log(np.maximum(sums[-1] - sums[count - 1], _TINY) / (column.size - count))
    best = int(np.argmin(early * count + late * (column.size - count)))
    return abs(float(late[best] - early[best])), int(count[best])


def _law(inputs: Samples, angle: Samples, length: int) -> Samples:
    """Return the (m, 5) weak-form terms of a joint's law, the input last; zeros if m is small."""
    if length < _LEAST or 2 * angle.size < (_LEAST + 1) * length:
        return np.zeros((1, 5))
    bump = (1.0 - np.linspace(-1.0, 1.0, length) ** 2) ** 4
    bend = np.gradient(slope := np.gradient(bump))
    level = _cut(angle, length)
    motion = level - level[:, :1]  # exactly 0 at rest
    speed, bent, drive = -(motion @ slope), motion @ bend, _cut(inputs, length) @ bump
    law = np.column_stack([bent, speed, level @ bump, np.sign(speed), drive])
    varies = np.ptp(law, axis=0) > 1e-9 * np.abs(law).max(axis=0)
    return np.where(varies, law - law.mean(axis=0), 0.0)


def _told(law: Samples, other: Samples) -> tuple[float, float]:
    """Return the share of other inputs that a law explains, and by which factor they exceed it."""
    size = np.maximum(np.linalg.norm(law[:, :-1], axis=0), _TINY)
    predicted = other[:, :-1] @ (
        np.linalg.lstsq(law[:, :-1] / size, law[:, -1], rcond=1e-9)[0] / size
    )
    common, whole = float(predicted @ other[:, -1]), float(other[:, -1] @ other[:, -1])
    share = common / max(math.sqrt(float(predicted @ predicted) * whole), _TINY)
    return share * abs(share), whole / common if common else 0.0


def _unreached(log: Log, inputs: Samples, angle: Samples) -> tuple[str, str] | None:
    """Find an input that has no part in the motion of a joint that friction does not hold."""
    laws = (_law(inputs, angle, angle.size // count) for count in _LADDER)
    shares = (_told(law, law)[0] - _CHANCE / len(law) for law in laws if len(law) > 1)
    follows = next(shares, 1.0) > _FAILS or any(share > _FAILS for share in shares)
    steps = [np.mean(np.diff(column) ** 2) / (np.var(column) + _TINY) for column in (inputs, angle)]
    if follows or not 0.0 < steps[0] < _NOISE:
        return None
    least, span = resolution_of(log.angle), np.ptp(angle)
    swings = np.quantile(np.ptp(_cut(angle, angle.size // _LADDER[0]), axis=1), _RARELY)
    moving = swings > _BY * least and span < math.pi  # a larger swing follows no such law
    if moving or (steps[1] > _NOISE and span > _NOISY * least):
        hint = "Check that the input reaches the joint, and is stronger than its friction."
        return f"from {log.time[0]:.4g} s on the angle does not respond to the input", hint
    return None
