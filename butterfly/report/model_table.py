"""What an identification says of the robot's own model: its table, and what was assumed."""

from __future__ import annotations

import math
from collections.abc import Iterator

from butterfly.identification.identified import Identified
from butterfly.report.page import PageTable
from butterfly.report.parameter_table import with_limit
from butterfly.twin.model_rows import ModelRow, facts_of, model_rows


def model_table(identified: Identified) -> PageTable:
    """Tabulate attributes of the robot's model: identified, and in the file; empty without one."""
    facts = facts_of(identified)
    if facts is None:
        return PageTable()
    rows = [
        (
            f"{row.name} {row.attribute}" if row.element != "joint" else row.attribute,
            with_limit(row.value, row.half_width) if math.isfinite(row.half_width) else "–",
            "" if row.now is None else f"{row.now:.5g}",
            row.unit,
            _place(row),
        )
        for row in model_rows(identified)
    ]
    headers = ("", "value ± 95 %", "in the file", "unit", "")
    title = f"Joint {facts.joint!r} of {facts.file}"
    caption = "Attributes of the model: what was identified, and what its file says."
    return PageTable(title, headers, rows, caption=caption, name="model")


def _place(row: ModelRow) -> str:
    """Say how the file's value and the interval lie."""
    if row.inside is None or row.now is None:
        return ""
    if row.inside:
        return "the file agrees"
    return "not in the file" if row.now == 0 else "the file differs"


def model_sentences(identified: Identified) -> Iterator[str]:
    """Say what was taken from the model, and what was assumed of the other joints."""
    facts = facts_of(identified)
    if facts is None:
        return
    share = f"{100 * facts.links.uncertainty:.3g} %"
    how = "each independently" if facts.links.independent else "with one common factor"
    yield f"Masses of the links are taken from {facts.file}, ± {share}, {how}."
    if facts.others:
        first, several = facts.poses[0].pose, len(facts.poses) > 1
        at = ", ".join(f"{name} {angle:.4g}" for name, angle in first.items())
        yield f"Pose of the other joints{f' (first of {len(facts.poses)})' * several}: {at}."
    yield from facts.warnings
