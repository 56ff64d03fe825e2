"""What a health record says of a log, and how much it matters."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from butterfly.verdict import Level

if TYPE_CHECKING:
    from butterfly.logs.health import Health

_MANY = 0.01  # share of the samples, or of the time, that may be missing without harm
_SLOW = 0.25  # s between samples in which a hand does what no log of it shows
_IF_DEGREES = (
    "A joint that does not turn round may be recorded in degrees or counts: say --units angle=deg, "
    "or units: {angle: deg} in the manifest."
)
_IF_MILLISECONDS = (
    "A clock so slow may count milliseconds: say --units time=ms, or units: {time: ms} in the "
    "manifest."
)


class Remark(NamedTuple):
    """Something that was found, how much it matters, and what to do about it."""

    condition: Level
    text: str
    hint: str = ""


def remarks_on(health: Health) -> list[Remark]:
    """Say what a health record holds, worst first."""
    lost = health.dropped > _MANY * health.samples
    gone = health.longest_gap > _MANY * health.duration
    counted = [
        (health.saturated, "sample", "with the input saturated", True),
        (health.clipped, "sample", "with the angle clipped", True),
        (health.gaps, "gap", f"bridged, longest {1e3 * health.longest_gap:.1f} ms", gone),
        (health.duplicate_stamps, "repeated stamp", "dropped", lost),
        (health.backward_stamps, "backward stamp", "dropped", lost),
        (health.non_finite, "sample", "not finite, dropped", lost),
        (health.wraps, "jump", "by a turn undone", False),
        (health.cut_lines, "last line", "cut off, dropped", False),
        (health.idle, "sample", "with the same input throughout", False),
    ]
    found = [
        _remark(care, f"{count} {thing}{'s' * (count > 1)} {what}")
        for count, thing, what, care in counted
        if count
    ]
    if health.turns > 1.0:
        text = f"turns {health.turns:.1f} times round"
        told = health.wraps or "angle" in health.units
        found.append(Remark(Level.NOTE, text, "" if told else _IF_DEGREES))
    if health.step > _SLOW:
        text = f"a sample in {health.step:.3g} s only"
        found.append(Remark(Level.CARE, text, _IF_MILLISECONDS))
    if health.units:
        listed = ", ".join(f"{name} {unit}" for name, unit in health.units.items())
        found.append(_remark(False, f"units of the file's own: {listed}"))
    return sorted(found, key=lambda remark: remark.condition is not Level.CARE)


def _remark(care: bool, text: str) -> Remark:
    return Remark(Level.CARE if care else Level.NOTE, text)
