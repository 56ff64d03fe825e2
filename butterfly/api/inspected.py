"""`inspect` and its results: the condition of logs, or a robot's parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Self

from butterfly.api.sources import Named, is_data, manifest_of, names_result, read, require_said
from butterfly.api.verbs import identify, numbers_of_logs, saved_identification
from butterfly.arguments import checked
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.experiment.schema import Experiment
from butterfly.experiment.simulate import planned_logs
from butterfly.experiment.source import read_experiment
from butterfly.files import locate
from butterfly.identification.estimators import OutputError
from butterfly.identification.forecast import forecast
from butterfly.identification.free_run import Setting
from butterfly.identification.parameter import lumped_numbers
from butterfly.logs.health import examine
from butterfly.logs.reading import numbers_named, read_pieces, with_parts
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import DRIVE, PARAMETERS, TERMS
from butterfly.plant.robot import HAND_MASS, PARTS
from butterfly.progress import Track, tracked, untracked
from butterfly.report.finding_texts import require_possible
from butterfly.report.format import field_unit
from butterfly.report.inspection import Inspection, inspect_logs
from butterfly.report.numbers import estimate_numbers
from butterfly.report.page import PageTable
from butterfly.report.summary import zero_sentences
from butterfly.result import Answer, text
from butterfly.twin.twin import Twin
from butterfly.verdict import Verdict

ARM = 0.104  # m


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
