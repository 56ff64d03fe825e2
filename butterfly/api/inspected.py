"""`inspect` and its results: the condition of logs, or a robot's parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path, PurePath
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Self

from pydantic import TypeAdapter

from butterfly.api.sources import Named, is_data, manifest_of, names_result, read, require_said
from butterfly.api.verbs import identify, numbers_of_logs, saved_identification
from butterfly.arguments import checked
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.experiment.schema import Experiment
from butterfly.experiment.simulate import planned_logs
from butterfly.experiment.source import read_experiment
from butterfly.files import locate
from butterfly.identification.estimators import OutputError
from butterfly.identification.forecast import Forecast, forecast
from butterfly.identification.free_run import Setting
from butterfly.identification.parameter import lumped_numbers
from butterfly.logs.health import examine
from butterfly.logs.manifest import Manifest
from butterfly.logs.reading import numbers_named, read_pieces, with_parts
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import DRIVE, PARAMETERS, TERMS
from butterfly.plant.robot import HAND_MASS, PARTS
from butterfly.progress import Track, tracked, untracked
from butterfly.report.finding_texts import require_possible
from butterfly.report.format import field_unit
from butterfly.report.inspection import (
    STATES,
    Inspected,
    conditions_text,
    health_rows,
    hints,
    inspect_logs,
    log_row,
    taken_sentences,
)
from butterfly.report.numbers import estimate_numbers
from butterfly.report.page import Badge, Page, PageTable, Section, tabulated
from butterfly.report.parameter_table import FORECAST_HEADERS, forecast_rows, forecast_sentences
from butterfly.report.summary import zero_sentences
from butterfly.result import Answer, cell_text, text
from butterfly.twin.twin import Twin
from butterfly.verdict import Level, Verdict

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

ARM = 0.104  # m

_ADVICE = {
    Level.GOOD: "No check found a problem with this log.",
    Level.NOTE: "Nothing needs to be done.",
    Level.CARE: "Check the findings before you use this log.",
}
_FORECAST = "What these logs can tell"
_FORECASTS = TypeAdapter(tuple[Forecast, ...])


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Inspection(Answer):
    """The condition of logs, worst first, and which parameters they can tell."""

    kind: ClassVar[str] = "inspection"
    table: ClassVar[str] = "logs"

    logs: tuple[Inspected, ...] = ()
    """The findings of each log; none if loaded."""

    @classmethod
    def of(
        cls,
        part: Manifest,
        seen: Sequence[Inspected],
        forecasts: Sequence[Forecast],
        more: Sequence[str],
    ) -> Inspection:
        """Tabulate findings on logs of a manifest, and forecasts; ``more`` ends the summary."""
        way = part.joint.way
        single = len(seen) == 1
        return cls(
            title=f"Logs of {part.name!r}",
            summary=(
                conditions_text([inspected.condition for inspected in seen]),
                *forecast_sentences(forecasts),
                *hints(seen),
                *taken_sentences(seen),
                *more,
            ),
            content={
                "data": {
                    "name": part.name,
                    "description": part.description,
                    "input": str(part.input),
                    "logs": len(seen),
                    "joint": str(part.joint),
                },
                "logs": [log_row(inspected) for inspected in seen],
                "before_fit": [
                    {**asdict(forecast), "word": str(forecast.word)} for forecast in forecasts
                ],
                "source": seen[0].name if single else part.name,
                "single": [
                    pair
                    for inspected in seen[: int(single)]
                    if inspected.log is not None and inspected.health is not None
                    for pair in health_rows(inspected.log, inspected.health)
                ],
            },
            units={
                **{f"logs.{name}": "s" for name in ("duration", "step", "jitter", "longest_gap")},
                "logs.angle": way,
                "logs.velocity": f"{way}/s",
                "logs.turns": "turns",
                "logs.middle": way,
                "before_fit.half_width": "the row's unit",
                "before_fit.expected": "1",
            },
            logs=tuple(seen),
        )

    @property
    def before_fit(self) -> tuple[Forecast, ...]:
        """What can be expected of each parameter's identification."""
        return _FORECASTS.validate_python(self.content["before_fit"])

    @property
    def source(self) -> str:
        """Name of the data, or of a single log."""
        return text(self.content["source"])

    @property
    def unusable(self) -> int:
        """Number of unusable logs."""
        return sum(row["condition"] == STATES[Level.WARNING] for row in self.rows())

    @property
    def _single(self) -> list[tuple[str, str]]:
        """All that is known of a single log; nothing if there are others."""
        return [(name, value) for name, value in self.content["single"]]

    def require_usable(self) -> None:
        """Raise InputError if some logs are unusable."""
        if self.unusable:
            expected = "usable logs; repair or exclude these (see the findings)"
            raise InputError(self.source, "logs", f"{self.unusable} unusable", expected)

    def shown_rows(self) -> list[dict[str, str]]:
        """Return a row for each log, formatted for reading."""
        return [
            {
                "log": text(row["log"]),
                "state": text(row["condition"]),
                "samples": cell_text(row.get("samples")),
                "s": f"{row['duration']:.3f}" if "duration" in row else "–",
                "ms": f"{1e3 * row['step']:.3f}" if "step" in row else "–",
                "findings": "; ".join(finding["text"] for finding in row["findings"]),
            }
            for row in self.rows()
        ]

    def tables(self) -> list[PageTable]:
        """Return logs with findings, all of a single one, the forecasts, and the other logs."""
        rows, forecasts = self.shown_rows(), forecast_rows(self.before_fit)
        lines, ok = [tuple(row.values()) for row in rows], STATES[Level.GOOD]
        findings, others = (
            [line for line in lines if (line[1] == ok) is fine] for fine in (False, True)
        )
        tables = [
            PageTable(self.source, (*rows[0],), findings),
            PageTable(_FORECAST, FORECAST_HEADERS, forecasts),
            PageTable("Without findings", (*rows[0],), others, detail=True),
        ]
        if self._single:
            state = ("state", rows[0]["state"]), ("findings", rows[0]["findings"] or "none")
            tables = [PageTable(self.source, (), [*state, *self._single]), tables[1]]
        return [table for table in tables if table.rows]

    def figures(self) -> dict[str, Figure]:
        """Return the recording of the first, and worst, log that can be read."""
        from butterfly.report.log_figures import recorded_figure  # noqa: PLC0415 - slow to import

        drawn = [inspected.log for inspected in self.logs if inspected.log is not None]
        return {"log": recorded_figure(drawn[0])} if drawn else {}

    def page(self) -> Page:
        """Return the page of `report`: of a single log all that is known of it."""
        page, forecasts = super().page(), forecast_rows(self.before_fit)
        table = PageTable(headers=FORECAST_HEADERS, rows=forecasts, words=(1, 2, 4))
        forecast = tabulated(_FORECAST, table)
        if not self._single:
            return replace(page, sections=[*forecast, *page.sections])
        lead, *sections = [*forecast, *self._of_single(page).parts]
        return replace(self._of_single(page), lead=lead, sections=sections)

    def _of_single(self, page: Page) -> Page:
        """Return the page with the condition of a single log on top, and its numbers."""
        (row,) = self.rows()
        state = next(level for level, word in STATES.items() if word == row["condition"])
        findings = [f"{finding['text']}." for finding in row["findings"]]
        table = PageTable(headers=(), rows=self._single, words=(1,))
        return replace(
            page,
            name=PurePath(self.source).name,
            badge=Badge(state, row["condition"].capitalize(), [_ADVICE[state], *findings]),
            lead=Section(title="In numbers", tables=(table,)),
            sections=[] if page.lead is None else [replace(page.lead, title="The log")],
        )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotModel(Answer):
    """The robot of an experiment, or the twin identified from data."""

    kind: ClassVar[str] = "model"

    made: Twin | None = None  # None if loaded
    note: str = ""

    @property
    def twin(self) -> Twin:
        """What it lists; InputError if it was loaded, as a file holds its numbers alone."""
        if self.made is None:
            raise InputError("model", "twin", "none in a file", "its experiment or saved result")
        return self.made

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], **more: Any) -> Self:  # noqa: ANN401 - own fields
        """Return the result of `to_dict`'s values (see `Answer.from_dict`)."""
        for name, value in content["listed"]:
            text(name), text(value)
        return super().from_dict(content, **more)

    def tables(self) -> list[PageTable]:
        """Return its parts, and its lumped parameters with the added mass."""
        return [PageTable("", (), tuple((name, value) for name, value in self.content["listed"]))]

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
        resonance, numbers = resonance_frequency(loaded), lumped_numbers(loaded, kind)
        parts = {part: getattr(robot, part) for part in PARTS}
        pairs = [
            *((part, _numbers_of(component)) for part, component in parts.items()),
            ("added mass", str(carried) if carried.mass else "none"),
            *((name, "{value:.6g} {unit}".format(**numbers[name])) for name in PARAMETERS[:4]),
            ("resonance", f"{resonance:.5g} rad/s"),
        ]
        return cls(
            title=f"The robot of {twin.name!r}",
            judged=verdict,
            summary=(*(() if verdict is None else verdict.lines), *((note,) if note else ())),
            content={
                "data": {"name": twin.name, "input": str(kind)},
                **besides,
                "carried": {"mass": carried.mass, "arm": carried.arm},
                **{
                    part: component
                    and {
                        name: {
                            "value": value,
                            "unit": "Ohm" if name == "resistance" else field_unit(f"robot.{name}"),
                        }
                        for name, value in asdict(component).items()
                    }
                    for part, component in parts.items()
                },
                "loaded": numbers,
                "rows": [
                    {"parameter": name, **numbers[name]}
                    for name in sorted(numbers, key=[*TERMS].index)
                ],
                "listed": pairs,
                "resonance": resonance,
            },
            units={"resonance": "rad/s", "carried.mass": "kg", "carried.arm": "m"},
            made=twin,
            note=note,
        )


def _numbers_of(part: Any) -> str:  # noqa: ANN401 - any part of a robot
    """Return a part's values that differ from the defaults, with units."""
    if part is None:
        return "rigid"
    named = (
        f"{field.name} {getattr(part, field.name):.6g} {field_unit(f'part.{field.name}')}".rstrip(
            " –"
        )
        for field in fields(part)
        if getattr(part, field.name) != field.default
    )
    return ", ".join(named) or "none"


@checked
def inspect(
    source: Named,
    *,
    logs: Sequence[int] | None = None,
    hand_mass: float | None = None,
    added_mass: float = 0.0,
    track: Track = untracked,
    **description: Any,  # noqa: ANN401 - what `read` takes
) -> Inspection | RobotModel:
    """Check logs for faults, and forecast which parameters they can tell.

    Checks clock, gaps, saturation and clipping; several logs come worst first, those without
    findings with --verbose. Of an experiment or a saved result: the robot's parameters instead.

    Parameters
    ----------
    source
        Logs, a folder of logs, a manifest, a saved result, an experiment, or a shipped name.
    logs
        Numbers of the logs, from 0, shown without a forecast. Default: all.
    hand_mass
        Mass of an identified moving body in kg; the motion does not depend on it. Default: chosen.
    added_mass
        Added mass in kg of the robot of an experiment or saved result, at ``arm`` (0.104 m).
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
    described = manifest_of(path, massless=True, **description)
    require_said(path, described)
    manifest = with_parts(described)
    numbers = numbers_of_logs("inspect", logs, len(manifest.logs))
    part = manifest.model_copy(update={"logs": [manifest.logs[k] for k in numbers]})
    seen = inspect_logs(part, track)
    if len(seen) == 1 and seen[0].log is None:
        ((_, recorded),) = read_pieces(part, part.logs[0])
        examine(recorded, part.repair)  # raises with the reason
    usable = [inspected.log for inspected in seen if inspected.log is not None]
    held = set[int]()
    for pattern in part.holdout:
        with suppress(InputError):  # it names no usable log
            held.update(numbers_named(usable, [pattern], part.name))
    trained = [log for k, log in enumerate(usable) if k not in held and logs is None]
    forecasts = tracked(track, "Looking ahead", forecast, trained, part.prior)
    zeros = zero_sentences(usable, manifest.prior)
    return Inspection.of(part, seen, forecasts, zeros)


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
