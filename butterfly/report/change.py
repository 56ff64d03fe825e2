"""What a comparison of two identifications says, in plain English and as a table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from butterfly.comparison.change import Change, ParameterChange
from butterfly.identification.diagnostics.unit_errors import listed
from butterfly.identification.parameter import unit_of
from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind
from butterfly.report.format import with_error

_NAMES = {
    "p1": "the inertia p1",
    "p2": "viscous friction p2",
    "p3": "the gravity moment p3",
    "p4": "the gain p4",
    "coulomb": "Coulomb friction",
    "delay": "the delay",
}

_WHOLE = 0.1  # share from which whole per cents are told

_LISTED = 4  # parameters of which it is said what would have been seen


def change_sentences(
    change: Change, kind: InputKind, joint: JointKind = JointKind.HINGE
) -> list[str]:
    """Say first whether the robot has changed, then how sure that is."""
    if change.changed:
        said = [_moved(each, unit_of(each.name, kind, joint)) for each in change.changed]
        if len(change.changed) < len(change.parameters):
            said.append("No other parameter has changed beyond what the data can tell.")
        return [" ".join(said)]
    if change.jointly_changed:
        said = [
            "Something has changed: together the parameters differ by more than chance explains "
            f"(probability {change.joint_probability:.1g}), though none does so alone."
        ]
        if change.ratio is not None and math.isfinite(change.ratio.relative):
            said.append(f"Clearest is the ratio {change.ratio.name}, which {_by(change.ratio)}.")
        return [" ".join(said)]
    return [f"No change can be seen{_seen(change)}."]


def untested_sentences(change: Change) -> list[str]:
    """Say of which parameters there is no evidence."""
    said = [f"Not compared: {name}, which {why}." for name, why in change.untested.items()]
    if math.isnan(change.joint_probability) and len(change.parameters) > 1:
        said.append(
            "The parameters were compared one by one only: these logs are too few to tell how "
            "their errors go together."
        )
    return said


def change_rows(
    change: Change, kind: InputKind, joint: JointKind = JointKind.HINGE
) -> list[dict[str, Any]]:
    """Return a row for each parameter that was compared."""
    return [
        {
            "parameter": each.name,
            "before": each.before,
            "after": each.after,
            "change in %": 100 * each.relative,
            "lower": each.interval[0],
            "upper": each.interval[1],
            "standard_error": each.error,
            "probability": each.corrected,
            "detectable": each.detectable,
            "changed": each.changed,
            "unit": unit_of(each.name, kind, joint),
        }
        for each in change.parameters
    ]


def shown_changes(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, str]]:
    """Return `change_rows` as a person reads them."""
    return [_shown(row) for row in rows]


def known(row: Mapping[str, Any]) -> bool:
    """Whether a row's parameter was known well enough for its change to be told in per cent."""
    return row["change in %"] is not None and math.isfinite(row["change in %"])


def _shown(row: Mapping[str, Any]) -> dict[str, str]:
    before, after, error = (row[key] for key in ("before", "after", "standard_error"))
    size, unit = (abs(before) / 100, " %") if known(row) else (1.0, "")
    digits = f".{_decimals(error / size)}f" if known(row) else ".2g"
    change, reach = (after - before) / size, (row["upper"] - row["lower"]) / 2 / size
    seen = row["detectable"] / size
    return {
        "": row["parameter"],
        "first": with_error(before, error),
        "second": with_error(after, error),
        "change, 95 %": f"{change:+{digits}} ± {reach:{digits}}{unit}",
        "by chance": f"{row['probability']:.2g}",
        "seen from": _percent(seen / 100) if known(row) else f"{seen:.2g}",
    }


def _decimals(error: float) -> int:
    """Return the places after the point that show the first digit of an error."""
    return max(-math.floor(math.log10(error)), 0)


def _moved(each: ParameterChange, unit: str) -> str:
    """Say which way a parameter has gone, and from where to where."""
    name = _NAMES.get(each.name, each.name)
    one, other = (with_error(value, each.error) for value in (each.before, each.after))
    return f"{name[0].upper()}{name[1:]} {_by(each)} (from {one} to {other} {unit})."


def _by(each: ParameterChange) -> str:
    """Say by how much, of a size that is known."""
    if not math.isfinite(each.relative):
        return "has changed"
    grown = each.difference * each.before > 0
    return f"has {'grown' if grown else 'shrunk'} by {_percent(abs(each.relative))}"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= _WHOLE else f"{100 * share:.2g} %"


def _seen(change: Change) -> str:
    """Say which changes would have been seen, the smallest first."""
    sizes = sorted(
        (each.detectable / abs(each.before), each.name)
        for each in change.parameters
        if math.isfinite(each.relative)
    )
    if not sizes:
        return ""
    parts = [f"{_percent(size)} of {name}" for size, name in sizes[:_LISTED]]
    return f"; one of more than {listed(parts)} would have been, four times in five"
