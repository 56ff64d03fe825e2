"""`inspect`: the condition of logs, a robot's parameters, or results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, fields, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from butterfly.api.joint_models import with_model, without_neighbours
from butterfly.api.saved import kind_of
from butterfly.api.sources import (
    Named,
    holds_logs,
    is_data,
    is_run,
    is_sweep,
    manifest_of,
    names_result,
    read,
    require_said,
    results_below,
)
from butterfly.api.verbs import ALL, identify, numbers_of_logs, options_text, saved_identification
from butterfly.arguments import checked
from butterfly.errors import IdentifiabilityError, InputError, listed
from butterfly.experiment.run import planned_logs
from butterfly.experiment.schema import Experiment
from butterfly.experiment.source import read_experiment
from butterfly.files import locate
from butterfly.identification.estimators import OutputError
from butterfly.identification.forecast import Forecast, forecast
from butterfly.identification.free_run import Setting
from butterfly.identification.trust import lumped_numbers
from butterfly.logs.health import examine
from butterfly.logs.log import Log
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
    FORECAST,
    STATES,
    Inspected,
    conditions_text,
    health_rows,
    hints,
    inspect_logs,
    log_columns,
    log_row,
    shared_sentences,
    shared_texts,
    taken_sentences,
)
from butterfly.report.numbers import estimate_numbers
from butterfly.report.page import Page, PageTable, Section, views
from butterfly.report.parameter_table import FORECAST_HEADERS, forecast_rows, forecast_sentences
from butterfly.report.summary import zero_sentences
from butterfly.result import Answer
from butterfly.twin.twin import Twin
from butterfly.verdict import Level, Verdict

ARM = 0.104  # m

_SECONDS = ("duration", "step", "jitter", "longest_gap")


class NamedTwin(NamedTuple):
    """The robot of an experiment, or the twin identified from data."""

    twin: Twin
    judged: Verdict | None = None  # on the estimate that it comes from
    note: str = ""  # on what nobody has said
    numbers: Mapping[str, Any] = MappingProxyType({})  # of that estimate


def inspection_answer(
    part: Manifest, seen: Sequence[Inspected], forecasts: Sequence[Forecast], more: Sequence[str]
) -> Answer:
    """Tabulate findings on logs of a manifest, and forecasts; ``more`` ends the summary."""
    single, way, ok = len(seen) == 1, part.joint.way, STATES[Level.GOOD]
    source, rows = seen[0].name if single else part.name, [*map(log_row, seen)]
    drawn = [inspected.log for inspected in seen if inspected.log is not None]
    pairs = [
        pair
        for inspected in seen[: int(single)]
        if inspected.log is not None and inspected.health is not None
        for pair in health_rows(inspected.log, inspected.health)
    ]
    shared = shared_texts(seen)
    columns = log_columns(shared)
    doubtful = PageTable.of(source, [r for r in rows if r["condition"] != ok], columns)
    sound = [row for row in rows if row["condition"] == ok]
    forecast = PageTable(FORECAST, FORECAST_HEADERS, forecast_rows(forecasts))
    tables = [
        doubtful,
        forecast,
        PageTable.of("Without findings", sound, columns, detail=True),
    ]
    if pairs:
        findings = str(columns["findings"](rows[0])) or "none"
        first = ("state", rows[0]["condition"]), ("findings", findings)
        tables = [PageTable(source, (), [*first, *pairs]), forecast]
    return Answer(
        kind="inspection",
        title=f"Logs of {part.name!r}",
        summary=(
            conditions_text([inspected.condition for inspected in seen]),
            *forecast_sentences(forecasts),
            *shared_sentences(seen, shared),
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
            "logs": rows,
            "before_fit": [
                {**asdict(forecast), "word": str(forecast.word)} for forecast in forecasts
            ],
            "source": source,
            "single": pairs,
            **views(tables),
        },
        units={
            **{f"logs.{name}": "s" for name in _SECONDS},
            "logs.angle": way,
            "logs.velocity": f"{way}/s",
            "logs.turns": "turns",
            "logs.middle": way,
            "before_fit.half_width": "the row's unit",
            "before_fit.expected": "1",
        },
        live=partial(_with_recording, drawn[0]) if drawn else None,
    )


def _with_recording(log: Log, page: Page) -> Page:
    """Return the page with the recording of a log: of a single one below its numbers."""
    from butterfly.report.log_figures import recorded_figure  # noqa: PLC0415 - slow to import

    figures = {"log": recorded_figure(log)}
    if page.numbers["single"]:
        return replace(page, sections=[*page.sections, Section(title="The log", figures=figures)])
    return replace(page, lead=Section(title="At a glance", figures=figures))


def unusable_logs(inspection: Answer) -> int:
    """Return the number of unusable logs."""
    return sum(row["condition"] == STATES[Level.WARNING] for row in inspection.rows())


def require_usable(inspection: Answer) -> None:
    """Raise InputError if some logs are unusable."""
    if count := unusable_logs(inspection):
        expected = "usable logs; repair or exclude these (see the findings)"
        raise InputError(inspection.content["source"], "logs", f"{count} unusable", expected)


def model_answer(named: NamedTwin) -> Answer:
    """List a robot's parts and lumped parameters, beside an estimate's numbers."""
    twin, verdict = named.twin, named.judged
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
    rows = [{"parameter": name, **numbers[name]} for name in sorted(numbers, key=[*TERMS].index)]
    truth = f"The robot that {twin.name!r} simulates: its true values."
    lines = verdict.lines if verdict else (truth,)
    tables = [PageTable("", (), pairs), PageTable.of("Lumped parameters", rows, detail=True)]
    return Answer(
        kind="model",
        title=f"The robot of {twin.name!r}",
        judged=verdict,
        summary=(*lines, *filter(None, [named.note])),
        content={
            "data": {"name": twin.name, "input": str(kind)},
            **named.numbers,
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
            "rows": rows,
            "listed": pairs,
            "resonance": resonance,
            **views(tables),
        },
        units={"resonance": "rad/s", "carried.mass": "kg", "carried.arm": "m"},
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
) -> Answer:
    """Check logs for faults, and forecast how well they determine the parameters.

    Checks clock, gaps, saturation and clipping. Several logs are listed worst first; --verbose adds
    those without findings. Of an experiment or a saved identification: the robot's parameters
    instead. Of a folder of results: what is in it, verdict first; of a run or sweep: its answer.

    Parameters
    ----------
    source
        Logs, a folder of logs, a manifest, an experiment, or a shipped name; a saved result, a
        folder of results, or a run of a sweep: results/NAME/NUMBER.
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
    path = Path(source)
    if _holds_results_alone(path):
        given = {"logs": logs, "hand_mass": hand_mass, "added_mass": added_mass or None}
        return _shown(path, given | description, track)
    path = locate(path)
    if names_result(path) or not is_data(path):
        arm = description.get("arm")
        return model_answer(robot_of(path, hand_mass=hand_mass, added_mass=added_mass, arm=arm))
    described = manifest_of(path, massless=True, **description)
    require_said(path, described)
    manifest = with_parts(_of_one_joint(described))
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
    trained: Sequence[Log]
    trained = [log for k, log in enumerate(usable) if k not in held and logs is None]
    with suppress(InputError):  # which the forecast explains
        trained = without_neighbours(part, trained)
    forecasts = tracked(track, "Looking ahead", forecast, trained, part.prior)
    zeros = zero_sentences(usable, manifest.prior)
    answer = inspection_answer(part, seen, forecasts, zeros)
    if path.is_dir() and (results := results_below(path)):
        names = listed([result.name for result in results])
        return replace(answer, note=f"Results are in this folder too, to inspect by name: {names}.")
    return answer


def _of_one_joint(manifest: Manifest) -> Manifest:
    """Return a manifest with the columns and facts of its model's joint; of several, refuse."""
    several = sorted({entry.of for entry in manifest.logs if entry.of})
    if manifest.model is not None and (manifest.of == ALL or (not manifest.of and several[1:])):
        expected = "one joint at a time, such as --of " + (several or ["elbow"])[0]
        raise InputError(manifest.name, "of", manifest.of or ", ".join(several), expected)
    return with_model(manifest)


def _holds_results_alone(path: Path) -> bool:
    """Whether a path is a run, a folder of results and no logs, or a saved result that is shown."""
    with suppress(OSError):  # a name that is too long names nothing
        if is_run(path) or is_sweep(path):
            return True
        if path.is_dir():
            results = results_below(path)
            return bool(results) and not holds_logs(path, results)
        return names_result(path) and path.is_file() and kind_of(path) not in {"", "identification"}
    return False


def _shown(path: Path, given: Mapping[str, Any], track: Track) -> Answer:
    """Show results; options of logs and robots are refused."""
    from butterfly.api.result_folders import results_answer  # noqa: PLC0415 - slow to import

    if names := [name for name, value in given.items() if value is not None]:
        expected = "no such option: these are results"
        raise InputError(path, "option", options_text(names), expected)
    return results_answer(path, track=track)


def robot_of(
    source: Named, *, hand_mass: float | None, added_mass: float, arm: float | None
) -> NamedTwin:
    """Return the robot of an experiment, or the twin of data or a saved result."""
    path = locate(Path(source))
    carried = AddedMass(mass=added_mass, arm=ARM if arm is None else arm)
    if not is_data(path):
        return NamedTwin(_of_experiment(read_experiment(path), carried))
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
    return NamedTwin(twin, verdict, note, result.basis() | estimate_numbers(result.estimate))


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
