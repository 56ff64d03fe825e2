"""Has my robot changed? Two identifications of it compared."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from butterfly.api.sources import Named
from butterfly.comparison.change import change
from butterfly.errors import InputError
from butterfly.identification.diagnostics.unit_errors import listed
from butterfly.identification.identification import Identification
from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind
from butterfly.report.change import (
    change_rows,
    change_sentences,
    known,
    shown_changes,
    untested_sentences,
)
from butterfly.result import Answer, aligned
from butterfly.verdict import Level

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Changed(Answer):
    """Whether the parameters of a robot have changed, and by how much."""

    kind: ClassVar[str] = "change"

    def shown_rows(self) -> list[dict[str, str]]:
        """Return the table as a person reads it."""
        return shown_changes(self.rows())

    def shown_lines(self) -> list[str]:
        """Return the table as lines."""
        return aligned(self.shown_rows())

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page, by name."""
        from plotly.graph_objects import Figure, Scatter  # noqa: PLC0415 - slow to import

        from butterfly.report.figures import GREY, PALETTE  # noqa: PLC0415 - slow to import

        rows = [row for row in self.rows() if known(row)]
        sizes = [abs(row["before"]) / 100 for row in rows]
        differences = [row["after"] - row["before"] for row in rows]
        drawn = Scatter(
            x=[row["parameter"] for row in rows],
            y=[each / size for each, size in zip(differences, sizes, strict=True)],
            error_y={
                "array": [
                    (row["upper"] - each) / size
                    for row, each, size in zip(rows, differences, sizes, strict=True)
                ]
            },
            mode="markers",
            marker={"color": PALETTE[0], "size": 9},
        )
        figure = Figure(drawn)
        figure.add_hline(y=0, line={"color": GREY, "width": 1, "dash": "dash"})
        figure.update_yaxes(title="change in %, with 95 % intervals")
        figure.update_layout(height=380)
        return {"changes": figure}


def changed(before: Identification | Named, after: Identification | Named) -> Changed:
    """Tell whether a robot has changed between two identifications from independent logs.

    Parameters
    ----------
    before, after
        Identifications, or the files where they were saved.

    Raises
    ------
    InputError
        If one is none, their inputs are of different kinds, or they have no parameter in common of
        which both know an error.
    """
    one, other = (_identified(each) for each in (before, after))
    kinds = [each.origin["input"] for each in (one, other)]
    if kinds[0] != kinds[1]:
        raise InputError("changed", "input", kinds[1], f"{kinds[0]}, as the first has it")
    joints = [JointKind(each.origin.get("joint", JointKind.HINGE)) for each in (one, other)]
    if joints[0] != joints[1]:
        raise InputError("changed", "joint", joints[1], f"{joints[0]}, as the first has it")
    found = change(one.estimate, other.estimate)
    kind, joint = InputKind(kinds[0]), joints[0]
    return Changed(
        title=f"{other.origin['name']!r} after {one.origin['name']!r}",
        summary=(
            *_with_reserve(change_sentences(found, kind, joint), one, other),
            *_warnings(one, other),
            *untested_sentences(found),
        ),
        content={
            "identifications": [_named(each) for each in (one, other)],
            "rows": change_rows(found, kind, joint),
        },
    )


def _named(found: Identification) -> dict[str, Any]:
    """Return which identification it was, for programs."""
    about = {key: found.origin[key] for key in ("name", "input", "logs")}
    return {**about, "estimator": found.estimator, **found.judged.numbers()}


def _identified(given: Identification | Named) -> Identification:
    from butterfly.api.saved import load  # noqa: PLC0415 - it loads what is defined here

    found = load(Path(given)) if isinstance(given, str | PathLike) else given
    if not isinstance(found, Identification):
        expected = "an identification, or the file where it was saved"
        raise InputError("changed", "result", type(found).__name__, expected)
    return found


def _with_reserve(said: list[str], *both: Identification) -> list[str]:
    """Say before anything else that values are not to be used."""
    places = [
        place
        for place, each in zip(_PLACES, both, strict=True)
        if each.judged.level is Level.WARNING
    ]
    if not places:
        return said
    return [f"Not to be relied on, since {listed(places)} is not to be used: {said[0]}", *said[1:]]


def _warnings(*both: Identification) -> list[str]:
    """Say what else than the robot may make a difference."""
    said = [
        f"The verdict on {place}: {each.judged.sentence}"
        for place, each in zip(_PLACES, both, strict=True)
        if each.judged.level is not Level.GOOD
    ]
    one, other = (each.estimate for each in both)
    if both[0].estimator != both[1].estimator:
        said.append(
            f"The first is by {both[0].estimator}, the second by {both[1].estimator}: a difference "
            "may be theirs."
        )
    terms = sorted(set(one.names) ^ set(other.names))
    if terms:
        said.append(
            f"Only one of them fits {listed(terms)}: what it takes up there, the other has in its "
            "other parameters."
        )
    in_both = one.fixed.keys() & other.fixed.keys()
    fixed = sorted(name for name in in_both if one.fixed[name] != other.fixed[name])
    if fixed:
        said.append(f"They hold {listed(fixed)} at different values, on which the others rest.")
    shared = _files(both[0]) & _files(both[1])
    if shared:
        said.append(
            f"{len(shared)} of the logs are in both: the errors are taken to be independent, so "
            "that a change is harder to see than it need be."
        )
    return said


def _files(found: Identification) -> set[Path]:
    """Return the files of its logs, as far as they are known."""
    manifest: dict[str, Any] | None = found.origin["manifest"]
    if manifest is None or manifest["root"] is None:
        return set()
    return {Path(manifest["root"]) / entry["file"] for entry in manifest["logs"]}


_PLACES = ("the first", "the second")
