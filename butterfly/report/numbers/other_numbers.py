"""Logs that were looked at, and figures of the thesis, as numbers for programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from butterfly.document import Told
from butterfly.logs.manifest import Manifest
from butterfly.report.inspection import STATES, Inspected
from butterfly.thesis.tables import Row


def told_inspection(manifest: Manifest, seen: Sequence[Inspected], said: Sequence[str]) -> Told:
    """Tell logs that were looked at, the worst first, and where the hand hangs in them."""
    joint = manifest.joint
    return Told(
        kind="inspection",
        title=f"Logs of {manifest.name!r}",
        summary=tuple(said),
        content={
            "data": {
                "name": manifest.name,
                "description": manifest.description,
                "input": str(manifest.input),
                "logs": len(seen),
                "joint": str(joint),
            },
            "logs": [_looked_at(each) for each in seen],
        },
        units={
            **{f"logs.{name}": "s" for name in ("duration", "step", "jitter", "longest_gap")},
            "logs.angle": joint.way,
            "logs.turns": "turns",
            "logs.middle": joint.way,
        },
    )


def _looked_at(seen: Inspected) -> dict[str, Any]:
    findings = [{**each._asdict(), "condition": STATES[each.condition]} for each in seen.remarks]
    said = {"log": seen.name, "condition": STATES[seen.condition]}
    if seen.health is None or seen.log is None:
        return {**said, "findings": findings}
    log, health = seen.log, asdict(seen.health)
    carried = log.added_mass
    return {
        **said,
        "samples": health.pop("samples"),
        "duration": health.pop("duration"),
        "step": health.pop("step"),
        "added_mass": {"mass": carried.mass, "arm": carried.arm},
        "input": [float(log.input.min()), float(log.input.max())],
        "angle": [float(log.angle.min()), float(log.angle.max())],
        **health,
        "findings": findings,
    }


def told_reproduction(rows: Sequence[Row]) -> Told:
    """Tell the thesis's figures, as printed, as obtained, and right, digit by digit as texts."""
    alike = sum(row.agrees for row in rows)
    return Told(
        kind="reproduction",
        title="The thesis, published against obtained",
        summary=(f"{alike} of {len(rows)} are the same.",),
        content={"rows": [{**asdict(row), "same": row.agrees} for row in rows]},
    )
