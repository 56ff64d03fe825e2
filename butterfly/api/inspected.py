"""What `inspect` returns: in which condition logs are, or what a robot is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

from butterfly.errors import InputError
from butterfly.identification.parameter import lumped_numbers, unit_of
from butterfly.logs.log import InputKind
from butterfly.logs.manifest import Manifest
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import TERMS
from butterfly.plant.robot import Robot
from butterfly.report.format import field_unit
from butterfly.report.inspection import (
    STATES,
    Inspected,
    conditions_text,
    health_rows,
    hints,
    inspection_page,
)
from butterfly.report.page import write_html
from butterfly.report.summary import zero_sentences
from butterfly.result import Answer, TextTable
from butterfly.verdict import Level, Verdict


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Inspection(Answer):
    """In which condition logs are, the worst first."""

    kind: ClassVar[str] = "inspection"
    table: ClassVar[str] = "logs"

    source: str
    """The data, in words."""

    logs: tuple[Inspected, ...]
    """What was found of each."""

    @classmethod
    def of(
        cls, source: str, whole: Manifest, part: Manifest, seen: Sequence[Inspected]
    ) -> Inspection:
        """Tabulate what was found of part of the logs of a manifest."""
        logs = [each.log for each in seen if each.log is not None]
        states = [each.condition for each in seen]
        way = part.joint.way
        return cls(
            title=f"Logs of {part.name!r}",
            summary=(
                *([conditions_text(states)] if len(seen) > 1 else []),
                *hints(remark for each in seen for remark in each.remarks),
                *zero_sentences(logs, whole.prior),
            ),
            content={
                "data": {
                    "name": part.name,
                    "description": part.description,
                    "input": str(part.input),
                    "logs": len(seen),
                    "joint": str(part.joint),
                },
                "logs": [_looked_at(each) for each in seen],
            },
            units={
                **{f"logs.{name}": "s" for name in ("duration", "step", "jitter", "longest_gap")},
                "logs.angle": way,
                "logs.turns": "turns",
                "logs.middle": way,
            },
            printed=(_one_log(part, seen[0]) if len(seen) == 1 else _every_log(source, seen),),
            source=source,
            logs=tuple(seen),
        )

    @property
    def unusable(self) -> int:
        """How many logs cannot be used."""
        return sum(each.condition is Level.WARNING for each in self.logs)

    def require_usable(self) -> None:
        """Raise InputError if there are logs that cannot be used."""
        if self.unusable:
            expected = "logs without such faults"
            raise InputError(self.source, "logs", f"{self.unusable} that cannot be used", expected)

    def plot(self, path: str | PathLike[str]) -> None:
        """Draw the one log that was looked at to a page.

        Raises
        ------
        InputError
            If there are several, or the file cannot be written.
        """
        (only,) = self.logs if len(self.logs) == 1 else (None,)
        if only is None or only.log is None or only.health is None:
            raise InputError(self.source, "plot", f"{len(self.logs)} logs", "one log (--log N)")
        write_html(inspection_page(only.log, only.health), Path(path))


def _looked_at(seen: Inspected) -> dict[str, Any]:
    findings = [{**each._asdict(), "condition": STATES[each.condition]} for each in seen.remarks]
    known: dict[str, Any] = {"log": seen.name, "condition": STATES[seen.condition]}
    if seen.health is not None and seen.log is not None:
        log, health = seen.log, asdict(seen.health)
        known |= {
            "samples": health.pop("samples"),
            "duration": health.pop("duration"),
            "step": health.pop("step"),
            "added_mass": {"mass": log.added_mass.mass, "arm": log.added_mass.arm},
            "input": [float(log.input.min()), float(log.input.max())],
            "angle": [float(log.angle.min()), float(log.angle.max())],
            **health,
        }
    return {**known, "findings": findings}


def _one_log(manifest: Manifest, seen: Inspected) -> TextTable:
    assert seen.log is not None and seen.health is not None  # noqa: S101, PT018 - it can be used
    path = Path(manifest.root) / seen.name
    return TextTable(str(path), (), health_rows(seen.log, seen.health))


def _every_log(source: str, seen: Sequence[Inspected]) -> TextTable:
    """Return a line for each log."""
    rows = []
    for each in seen:
        health = each.health
        numbers = ("–", "–", "–")
        if health is not None:
            numbers = (f"{health.samples}", f"{health.duration:.3f}", f"{1e3 * health.step:.3f}")
        rows.append((each.name, STATES[each.condition], *numbers, each.findings))
    return TextTable(source, ("log", "state", "samples", "s", "ms", "findings"), rows)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotModel(Answer):
    """The robot of an experiment, or the identified twin of data."""

    kind: ClassVar[str] = "model"

    robot: Robot
    carried: AddedMass
    command: Mapping[str, float]  # what `butterfly.plant.stand_alone` takes of it
    note: str = ""

    @classmethod
    def of(
        cls,
        name: str,
        robot: Robot,
        carried: AddedMass,
        kind: InputKind,
        command: Mapping[str, float],
        *,
        verdict: Verdict | None = None,
        note: str = "",
        besides: Mapping[str, Any] = MappingProxyType({}),
    ) -> RobotModel:
        """List the parts of a robot, and the lumped parameters with what it carries.

        Of data, the verdict and what is ``besides`` are on the estimate that it rests on.
        """
        loaded = robot.lumped.with_added_mass(carried)
        resonance = resonance_frequency(loaded)
        parts = {part: getattr(robot, part) for part in ("hand", "drive", "friction", "clutch")}
        pairs = (
            ("hand", _numbers_of(robot.hand)),
            ("drive", _numbers_of(robot.drive)),
            ("friction", _numbers_of(robot.friction) or "none"),
            ("clutch", _numbers_of(robot.clutch) if robot.clutch else "rigid"),
            ("added mass", str(carried) if carried.mass else "none"),
            ("p1", f"{loaded.p1:.6g} kg m²"),
            ("p2", f"{loaded.p2:.6g} N m s/rad"),
            ("p3", f"{loaded.p3:.6g} N m"),
            ("p4", f"{loaded.p4:.6g} {unit_of('p4', kind)}"),
            ("resonance", f"{resonance:.5g} rad/s"),
        )
        return cls(
            title=f"The robot of {name!r}",
            judged=verdict,
            summary=(*(() if verdict is None else verdict.lines), *((note,) if note else ())),
            content={
                "data": {"name": name, "input": str(kind)},
                **besides,
                "carried": {"mass": carried.mass, "arm": carried.arm},
                **{
                    part: each
                    and {
                        name: {
                            "value": value,
                            "unit": "Ohm" if name == "resistance" else field_unit(f"robot.{name}"),
                        }
                        for name, value in asdict(each).items()
                    }
                    for part, each in parts.items()
                },
                "loaded": lumped_numbers(loaded, kind),
                "resonance": resonance,
            },
            units={"resonance": "rad/s", "carried.mass": "kg", "carried.arm": "m"},
            printed=(TextTable("", (), pairs),),
            robot=robot,
            carried=carried,
            command=command,
            note=note,
        )

    def rows(self) -> list[dict[str, Any]]:
        """Return a row for each lumped parameter, with what the robot carries."""
        loaded = self.content["loaded"]
        names = sorted(loaded, key=[*TERMS].index)
        return [{"parameter": name, **loaded[name]} for name in names]


def _numbers_of(part: object) -> str:
    """Name the numbers of one part that are not at their defaults, with their units."""
    return ", ".join(
        f"{each.name} {getattr(part, each.name):.6g} {field_unit(f'part.{each.name}')}".rstrip(" –")
        for each in fields(part)  # type: ignore[arg-type]
        if getattr(part, each.name) != each.default
    )
