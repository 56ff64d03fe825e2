"""Has my robot changed? What a comparison of two identifications of it says."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from butterfly.comparison.change import Change, ParameterChange, change
from butterfly.errors import InputError, listed
from butterfly.identification.identification import Identification
from butterfly.identification.parameter import unit_of
from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind
from butterfly.report.format import with_error
from butterfly.result import Answer
from butterfly.verdict import Level

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from butterfly.report.page import Fact

_NAMES = {
    "p1": "the inertia p1",
    "p2": "viscous friction p2",
    "p3": "the gravity moment p3",
    "p4": "the gain p4",
    "coulomb": "Coulomb friction",
    "delay": "the delay",
}
_PLACES = ("the first", "the second")
_WHOLE = 0.1  # share from which whole per cents are given
_LISTED = 4  # parameters whose detectable change is named


class Changed(Answer):
    """Whether the parameters of a robot have changed, and by how much."""

    kind: ClassVar[str] = "change"
    short: ClassVar[bool] = True

    @classmethod
    def of(cls, one: Identification, other: Identification) -> Changed:
        """Compare two identifications; InputError if that cannot be."""
        for name in ("input", "joint"):
            first, second = (each.origin.get(name, JointKind.HINGE) for each in (one, other))
            if first != second:
                raise InputError("changed", name, second, f"{first}, as the first has it")
        found = change(one.estimate, other.estimate)
        kind = InputKind(one.origin["input"])
        joint = JointKind(one.origin.get("joint", JointKind.HINGE))
        units = {each.name: unit_of(each.name, kind, joint) for each in found.parameters}
        return cls(
            title=f"{other.origin['name']!r} after {one.origin['name']!r}",
            summary=(
                _reserve(one, other) + _answer(found, units),
                *_warnings(one, other),
                *_untested(found),
            ),
            content={
                "identifications": [
                    {
                        **{key: each.origin[key] for key in ("name", "input", "logs")},
                        "estimator": each.estimator,
                        **each.judged.numbers(),
                    }
                    for each in (one, other)
                ],
                "rows": [
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
                        "unit": units[each.name],
                    }
                    for each in found.parameters
                ],
            },
        )

    def shown_rows(self) -> list[dict[str, str]]:
        """Return the table as a person reads it."""
        return [_shown(row) for row in self.rows()]

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page, by name."""
        from plotly.graph_objects import Figure, Scatter  # noqa: PLC0415 - slow to import

        from butterfly.report.figures import GREY, PALETTE  # noqa: PLC0415 - slow to import

        rows = [row for row in self.rows() if _is_relative(row)]
        moved = [row["change in %"] for row in rows]
        upper = [100 * row["upper"] / abs(row["before"]) for row in rows]
        names, places = [row["parameter"] for row in rows], list(range(len(rows)))
        drawn = Scatter(
            x=moved,
            y=places,
            error_x={"array": [most - own for most, own in zip(upper, moved, strict=True)]},
            mode="markers",
            marker={"color": [PALETTE[5 if row["changed"] else 0] for row in rows], "size": 9},
        )
        figure = Figure(drawn)
        figure.add_vline(x=0, line={"color": GREY, "width": 1, "dash": "dash"})
        figure.update_xaxes(title="change in %, with 95 % intervals")
        figure.update_yaxes(tickvals=places, ticktext=names, range=[len(rows) - 0.4, -0.6])
        figure.update_layout(height=40 * len(rows) + 110)
        return {"changes": figure}

    def facts(self) -> list[Fact]:
        """Return the numbers that matter most."""
        from butterfly.report.page import Fact  # noqa: PLC0415 - a view

        rows = self.rows()
        moved = [row["parameter"] for row in rows if row["changed"]]
        sizes = {row["parameter"]: row for row in rows if _is_relative(row)}
        seen = {name: row["detectable"] / abs(row["before"]) for name, row in sizes.items()}
        least = min(seen, key=lambda name: seen[name], default="")
        largest = max(
            moved,
            key=lambda name: abs(sizes[name]["change in %"]) if name in sizes else 0,
            default="",
        )
        found = [Fact("changed", f"{len(moved)} of {len(rows)}", ", ".join(moved) or "none")]
        if largest in sizes:
            found.append(Fact("largest change", f"{sizes[largest]['change in %']:+.2g} %", largest))
        if least:
            found.append(Fact("detectable change", _percent(seen[least]), f"in {least}, the least"))
        return found


def _is_relative(row: Mapping[str, Any]) -> bool:
    """Whether a row's parameter was known well enough for its change to be given in per cent."""
    return row["change in %"] is not None and math.isfinite(row["change in %"])


def _shown(row: Mapping[str, Any]) -> dict[str, str]:
    before, after, error = (row[key] for key in ("before", "after", "standard_error"))
    relative = _is_relative(row)
    size, unit = (abs(before) / 100, " %") if relative else (1.0, "")
    # decimals that show the first digit of the error
    digits = f".{max(-math.floor(math.log10(error / size)), 0)}f" if relative else ".2g"
    moved, reach = (after - before) / size, (row["upper"] - row["lower"]) / 2 / size
    seen = row["detectable"] / size
    return {
        "": row["parameter"],
        "first": with_error(before, error),
        "second": with_error(after, error),
        "change, 95 %": f"{moved:+{digits}} ± {reach:{digits}}{unit}",
        "by chance": f"{row['probability']:.2g}",
        "seen from": _percent(seen / 100) if relative else f"{seen:.2g}",
    }


def _answer(found: Change, units: Mapping[str, str]) -> str:
    """Say whether the robot has changed, and how sure that is."""
    if found.changed:
        moved = [_moved(each, units[each.name]) for each in found.changed]
        if len(found.changed) < len(found.parameters):
            moved.append("No other parameter has changed beyond what the data can tell.")
        return " ".join(moved)
    if not found.jointly_changed:
        return f"No change can be seen{_seen(found)}."
    together = (
        "Something has changed: together the parameters differ by more than chance explains "
        f"(probability {found.joint_probability:.1g}), though none does so alone."
    )
    if found.ratio is None or not math.isfinite(found.ratio.relative):
        return together
    return f"{together} Clearest is the ratio {found.ratio.name}, which {_by(found.ratio)}."


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


def _seen(found: Change) -> str:
    """Say which changes would have been seen, the smallest first."""
    sizes = sorted(
        (each.detectable / abs(each.before), each.name)
        for each in found.parameters
        if math.isfinite(each.relative)
    )
    if not sizes:
        return ""
    parts = [f"{_percent(size)} of {name}" for size, name in sizes[:_LISTED]]
    return f"; one of more than {listed(parts)} would have been, four times in five"


def _untested(found: Change) -> list[str]:
    """Say of which parameters there is no evidence."""
    sentences = [f"Not compared: {name}, which {why}." for name, why in found.untested.items()]
    if math.isnan(found.joint_probability) and len(found.parameters) > 1:
        sentences.append(
            "The parameters were compared one by one only: these logs are too few to tell how "
            "their errors go together."
        )
    return sentences


def _reserve(*both: Identification) -> str:
    """Say which values are not to be used, before anything else; nothing if both may be."""
    places = [
        place
        for place, each in zip(_PLACES, both, strict=True)
        if each.judged.level is Level.WARNING
    ]
    return f"Not to be relied on, since {listed(places)} is not to be used: " if places else ""


def _warnings(*both: Identification) -> list[str]:
    """Say what else than the robot may make a difference."""
    sentences = [
        f"The verdict on {place}: {each.judged.lines[0]}"
        for place, each in zip(_PLACES, both, strict=True)
        if each.judged.level is not Level.GOOD
    ]
    one, other = (each.estimate for each in both)
    if both[0].estimator != both[1].estimator:
        sentences.append(
            f"The first is by {both[0].estimator}, the second by {both[1].estimator}: a difference "
            "may be theirs."
        )
    terms = sorted(set(one.names) ^ set(other.names))
    if terms:
        sentences.append(
            f"Only one of them fits {listed(terms)}: what it takes up there, the other has in its "
            "other parameters."
        )
    in_both = one.fixed.keys() & other.fixed.keys()
    fixed = sorted(name for name in in_both if one.fixed[name] != other.fixed[name])
    if fixed:
        sentences.append(
            f"They hold {listed(fixed)} at different values, on which the others rest."
        )
    shared = _files(both[0]) & _files(both[1])
    if shared:
        sentences.append(
            f"{len(shared)} of the logs are in both: the errors are taken to be independent, so "
            "that a change is harder to see than it need be."
        )
    return sentences


def _files(found: Identification) -> set[Path]:
    """Return the files of its logs, as far as they are known."""
    manifest: dict[str, Any] | None = found.origin["manifest"]
    if manifest is None or manifest["root"] is None:
        return set()
    return {Path(manifest["root"]) / entry["file"] for entry in manifest["logs"]}
