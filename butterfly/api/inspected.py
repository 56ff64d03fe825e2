"""`inspect` and its results: the condition of logs, or a robot's parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

from butterfly.api.sources import Named, is_data, manifest_of, names_result, read
from butterfly.api.verbs import identify, numbers_of_logs, saved_identification
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.experiment.schema import Experiment
from butterfly.experiment.simulate import planned_logs
from butterfly.experiment.source import read_experiment
from butterfly.files import locate
from butterfly.identification.estimators import OutputError
from butterfly.identification.free_run import Setting
from butterfly.identification.parameter import lumped_numbers, unit_of
from butterfly.logs.health import examine
from butterfly.logs.manifest import Manifest
from butterfly.logs.reading import read_pieces, with_parts
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import DRIVE, TERMS
from butterfly.plant.robot import HAND_MASS, PARTS
from butterfly.progress import Track, untracked
from butterfly.report.finding_texts import require_possible
from butterfly.report.format import field_unit
from butterfly.report.inspection import (
    STATES,
    Inspected,
    conditions_text,
    health_rows,
    hints,
    inspect_logs,
    inspection_page,
)
from butterfly.report.numbers import estimate_numbers
from butterfly.report.page import Page
from butterfly.report.summary import zero_sentences
from butterfly.result import Answer, TextTable
from butterfly.twin.twin import Twin
from butterfly.verdict import Level, Verdict

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

ARM = 0.104  # m


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Inspection(Answer):
    """The condition of logs, worst first."""

    kind: ClassVar[str] = "inspection"
    table: ClassVar[str] = "logs"

    source: str
    """Name of the data."""

    logs: tuple[Inspected, ...]
    """The findings of each log."""

    @classmethod
    def of(
        cls, source: str, whole: Manifest, part: Manifest, seen: Sequence[Inspected]
    ) -> Inspection:
        """Tabulate the findings of some logs of a manifest."""
        logs = [each.log for each in seen if each.log is not None]
        states = [each.condition for each in seen]
        way = part.joint.way
        return cls(
            title=f"Logs of {part.name!r}",
            summary=(
                *([conditions_text(states)] if len(seen) > 1 else []),
                *hints(seen),
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
                "logs.velocity": f"{way}/s",
                "logs.turns": "turns",
                "logs.middle": way,
            },
            printed=(_table(source, part, seen),),
            source=source,
            logs=tuple(seen),
        )

    @property
    def unusable(self) -> int:
        """Number of unusable logs."""
        return sum(each.condition is Level.WARNING for each in self.logs)

    def require_usable(self) -> None:
        """Raise InputError if some logs are unusable."""
        if self.unusable:
            expected = "usable logs; repair or exclude these (see the findings)"
            raise InputError(self.source, "logs", f"{self.unusable} unusable", expected)

    def shown_rows(self) -> list[dict[str, str]]:
        """Return a row for each log, formatted for reading."""
        (table,) = self.printed
        if not table.headers:  # pairs of a single log
            return [{str(name): str(value) for name, value in table.rows}]
        return [dict(zip(table.headers, map(str, row), strict=True)) for row in table.rows]

    def figures(self) -> dict[str, Figure]:
        """Return the recording of the first, and worst, log that can be read."""
        from butterfly.report.log_figures import recorded_figure  # noqa: PLC0415 - slow to import

        drawn = [each.log for each in self.logs if each.log is not None]
        return {"log": recorded_figure(drawn[0])} if drawn else {}

    def page(self) -> Page:
        """Return the page of `report`: of a single log all that is known of it."""
        first, *others = self.logs
        if others or first.log is None or first.health is None:
            return super().page()
        return inspection_page(first.log, first.health, self.to_dict())


def _looked_at(seen: Inspected) -> dict[str, Any]:
    known: dict[str, Any] = {"log": seen.name, "condition": STATES[seen.condition]}
    if seen.health is not None and seen.log is not None:
        log, health = seen.log, asdict(seen.health)
        first = {name: health.pop(name) for name in ("samples", "duration", "step")}
        health["regimes"] = [each._asdict() for each in seen.health.regimes]
        known |= {
            **first,
            "added_mass": {"mass": log.added_mass.mass, "arm": log.added_mass.arm},
            "input": [float(log.input.min()), float(log.input.max())],
            log.measures: [float(log.measured.min()), float(log.measured.max())],
            **health,
        }
    findings = [{**each._asdict(), "condition": STATES[each.condition]} for each in seen.remarks]
    return {**known, "findings": findings}


def _table(source: str, manifest: Manifest, seen: Sequence[Inspected]) -> TextTable:
    """Return all details of one log, or one line for each of several."""
    if len(seen) == 1:
        log, health = seen[0].log, seen[0].health
        assert log is not None and health is not None  # noqa: S101, PT018 - it can be used
        return TextTable(str(Path(manifest.root) / seen[0].name), (), health_rows(log, health))
    rows = []
    for each in seen:
        numbers = ("–", "–", "–")
        if (health := each.health) is not None:
            numbers = (f"{health.samples}", f"{health.duration:.3f}", f"{1e3 * health.step:.3f}")
        rows.append((each.name, STATES[each.condition], *numbers, each.findings))
    return TextTable(source, ("log", "state", "samples", "s", "ms", "findings"), rows)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotModel(Answer):
    """The robot of an experiment, or the twin identified from data."""

    kind: ClassVar[str] = "model"

    twin: Twin
    note: str = ""

    @classmethod
    def of(
        cls,
        twin: Twin,
        *,
        verdict: Verdict | None = None,
        note: str = "",
        besides: Mapping[str, Any] = MappingProxyType({}),
    ) -> RobotModel:
        """List a robot's parts and lumped parameters; ``besides`` has an estimate's numbers."""
        (robot, carried), kind = twin.built, twin.kind
        loaded = robot.lumped.with_added_mass(carried)
        resonance = resonance_frequency(loaded)
        parts = {part: getattr(robot, part) for part in PARTS}
        pairs = (
            *((part, _numbers_of(each)) for part, each in parts.items()),
            ("added mass", str(carried) if carried.mass else "none"),
            ("p1", f"{loaded.p1:.6g} kg m²"),
            ("p2", f"{loaded.p2:.6g} N m s/rad"),
            ("p3", f"{loaded.p3:.6g} N m"),
            ("p4", f"{loaded.p4:.6g} {unit_of('p4', kind)}"),
            ("resonance", f"{resonance:.5g} rad/s"),
        )
        return cls(
            title=f"The robot of {twin.name!r}",
            judged=verdict,
            summary=(*(() if verdict is None else verdict.lines), *((note,) if note else ())),
            content={
                "data": {"name": twin.name, "input": str(kind)},
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
            twin=twin,
            note=note,
        )

    def rows(self) -> list[dict[str, Any]]:
        """Return a row for each lumped parameter, with the added mass."""
        loaded = self.content["loaded"]
        return [{"parameter": name, **loaded[name]} for name in sorted(loaded, key=[*TERMS].index)]


def _numbers_of(part: Any) -> str:  # noqa: ANN401 - any part of a robot
    """Return a part's values that differ from the defaults, with units."""
    if part is None:
        return "rigid"
    named = (
        f"{each.name} {getattr(part, each.name):.6g} {field_unit(f'part.{each.name}')}".rstrip(" –")
        for each in fields(part)
        if getattr(part, each.name) != each.default
    )
    return ", ".join(named) or "none"


def inspect(
    source: Named,
    *,
    logs: Sequence[int] | None = None,
    hand_mass: float | None = None,
    added_mass: float = 0.0,
    track: Track = untracked,
    **description: Any,  # noqa: ANN401 - what `read` takes
) -> Inspection | RobotModel:
    """Check logs for faults, or return a robot's parameters.

    Parameters
    ----------
    source
        Logs to check: a log, a folder, a manifest or a shipped data set's name. Or an experiment or
        a saved identification, for its robot.
    logs
        Numbers of the logs. Default: all.
    hand_mass
        Mass of an identified moving body in kg; the motion does not depend on it. Default: chosen.
    added_mass
        Added mass of the robot in kg.
    track
        Progress callback.
    description
        Fields of a manifest, as in `read`.

    Raises
    ------
    InputError
        If the source cannot be read, or a single log is unusable.
    """
    path = locate(Path(source))
    if names_result(path) or not is_data(path):
        return robot_of(
            path, hand_mass=hand_mass, added_mass=added_mass, arm=description.get("arm")
        )
    manifest = with_parts(manifest_of(path, massless=True, **description))
    numbers = numbers_of_logs("inspect", logs, len(manifest.logs))
    part = manifest.model_copy(update={"logs": [manifest.logs[k] for k in numbers]})
    seen = inspect_logs(part, track)
    if len(seen) == 1 and seen[0].log is None:
        ((_, recorded),) = read_pieces(part, part.logs[0])
        examine(recorded, part.repair)  # raises with the reason
    return Inspection.of(str(source), manifest, part, seen)


def robot_of(
    source: Named, *, hand_mass: float | None, added_mass: float, arm: float | None
) -> RobotModel:
    """Return the robot of an experiment, or the twin of data or a saved result."""
    path = locate(Path(source))
    carried = AddedMass(mass=added_mass, arm=ARM if arm is None else arm)
    if not is_data(path):
        return RobotModel.of(_of_experiment(read_experiment(path), carried))
    result = saved_identification(path)
    if result is None:
        data = read(path, arm=arm)
        try:
            result = identify(data, OutputError())
        except IdentifiabilityError:
            remedy = "a saved result; `butterfly identify` says what these logs lack"
            raise InputError(path, "parameters", "no identifiable values", remedy) from None
    verdict = require_possible(result.estimate)
    twin = result.model.twin(carried, hand_mass=hand_mass)
    note = ""
    if hand_mass is None and twin.built[0].hand.mass > HAND_MASS:
        note = (
            f"Mass set to {twin.built[0].hand.mass:.3g} kg (change: export --hand-mass). The "
            f"motion does not depend on it; the default {HAND_MASS:g} kg is too small for p1 and "
            "p3."
        )
    besides = {**result.basis(), **estimate_numbers(result.estimate)}
    return RobotModel.of(twin, verdict=verdict, note=note, besides=besides)


def _of_experiment(plan: Experiment, added: AddedMass) -> Twin:
    """Return the twin of an experiment's robot."""
    robot, path = plan.plant.robot, plan.plant.path
    p = replace(robot.lumped, **{name: getattr(path, name) for name in ("delay", *DRIVE)})
    return Twin(
        name=plan.name,
        parameters=p,
        added=added,
        kind=plan.input_kind,
        limit=path.limit,
        resolution=path.resolution,
        servo=plan.plant.servo,
        robot=robot,
        recorded=lambda: [
            (log, Setting(parameters=p, zero=0.0))
            for log in (() if plan.plant.servo else planned_logs(plan))
        ],
    )
