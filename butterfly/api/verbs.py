"""`identify`, `identify_joints`, and what all verbs of an estimate take."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from operator import index
from os import PathLike
from pathlib import Path
from typing import Any

from butterfly.api.identification import Identification
from butterfly.api.joint_models import logs_of_joints, of_joint, with_heavier_neighbours, with_model
from butterfly.api.saved import load
from butterfly.api.sources import Data, Named, manifest_of, names_result, read
from butterfly.arguments import checked
from butterfly.errors import ButterflyError, InputError, listed, nearest
from butterfly.experiment.methods import make_estimator
from butterfly.identification.data import DataSet, read_data_set
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import DEFAULT_METHOD, Estimator
from butterfly.identification.identified import read_parameters
from butterfly.identification.identify import identify as identify_data
from butterfly.identification.identify import judged, with_other
from butterfly.logs.manifest import LogEntry, Manifest
from butterfly.model.parameters import LumpedParameters
from butterfly.progress import Track, phase, untracked
from butterfly.report.format import fit_text
from butterfly.report.page import Fact, PageTable, views
from butterfly.report.parameter_table import model_table, values_table, with_limit
from butterfly.result import Answer
from butterfly.twin.model_rows import model_rows
from butterfly.verdict import Level, Verdict

Method = str | Estimator


@checked
def identify(
    data: Data,
    method: Method = DEFAULT_METHOD,
    *,
    against: Mapping[str, Identification | LumpedParameters | Mapping[str, Any]] | None = None,
    holdout: Sequence[str] = (),
    track: Track = untracked,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Identification:
    """Identify the joint from logs.

    The result has a verdict, and the parameters with 95 % intervals.

    Parameters
    ----------
    data
        Logs, a folder of logs, a manifest, a saved result, or a shipped data set's name. Anything
        else that `read` takes, or its result.
    method
        ``output-error``, the same as ``auto``; ``weak-form``; or, for a fast look at sines,
        ``harmonic-balance``, ``linear`` or ``thesis``; or an `Estimator`.
    against
        Parameters to compare with: p1=0.003,p2=0.001,p3=0.05. Without p4, the best-fitting one.
        In Python a mapping from names to an `Identification`, `LumpedParameters` or mappings.
    holdout
        Names or glob patterns of held-out logs: predicted, never fitted.
    track
        Progress callback.
    options
        Options of the method, named as in `butterfly identify --help-all`: ``terms=("drag",)``.
    """
    if not isinstance(against, Mapping | None):
        raise InputError("identify", "against", against, "a mapping of names to parameters")
    others = {name: _parameters(name, given) for name, given in (against or {}).items()}
    logs, estimator = prepared(data, method, options, holdout)
    with phase("Identifying"):
        identified = identify_data(logs, estimator, against=others, track=track)
        if (heavier := with_heavier_neighbours(logs)) is not None:
            # what was taken off the input rests on the masses of links
            other = estimator(heavier).named
            identified = replace(identified, estimate=with_other(identified.estimate, other))
        return Identification.of(identified)


def saved_identification(data: Data) -> Identification | None:
    """Return data that are an identification, or its saved file; None for other data."""
    if isinstance(data, Identification):
        return data
    if names_result(data):
        result = load(data)
        if isinstance(result, Identification):
            return result
        raise InputError(data, "schema", result.kind, "a saved identification")
    return None


def require_identification(result: Identification | Named, verb: str = "predict") -> Identification:
    """Return an identification, loaded if need be; InputError for anything else."""
    identification = load(result) if isinstance(result, str | PathLike) else result
    if not isinstance(identification, Identification):
        expected = "an identification or its saved file"
        raise InputError(verb, "result", type(identification).__name__, expected)
    return identification


def prepared(
    data: Data, method: Method, options: Mapping[str, Any], holdout: Sequence[str]
) -> tuple[DataSet, Estimator]:
    """Return logs and the estimator of a method; a wrong option is refused first."""
    estimator = make_estimator(method, options)
    logs = read(data).holding_out(holdout)
    return logs, estimator


def estimated(
    data: Data, method: Method | None, options: Mapping[str, Any], holdout: Sequence[str]
) -> tuple[DataSet, Estimator | None, Estimate]:
    """Return logs, estimator and estimate: of a result, or identified now."""
    result = saved_identification(data)
    if result is not None:
        if method is not None or options or holdout:
            others = {"method": method is not None, "holdout": holdout}
            names = [*(name for name, value in others.items() if value), *options]
            expected = "no such option with a saved result, which already has an estimate"
            raise InputError("butterfly", "option", options_text(names), expected)
        return result.data, result.made_by, result.estimate
    logs, estimator = prepared(data, method or DEFAULT_METHOD, options, holdout)
    logs, fitted = judged(logs, estimator)
    return logs, estimator, fitted


def options_text(names: Iterable[str]) -> str:
    """Name parameters of verbs as options of their commands."""
    return ", ".join(f"--{'log' if name == 'logs' else name.replace('_', '-')}" for name in names)


def _parameters(name: str, given: Any) -> LumpedParameters:  # noqa: ANN401 - whatever was given
    if isinstance(given, Identification | LumpedParameters):
        return given if isinstance(given, LumpedParameters) else given.parameters
    if not isinstance(given, Mapping):
        raise InputError("against", name, given, "parameters by name, such as {'p1': 0.003, ...}")
    return read_parameters(given, f"against {name}")


def numbers_of_logs(verb: str, logs: Sequence[int] | None, count: int) -> list[int]:
    """Return the checked numbers of logs; all if ``logs`` is None."""
    if logs is None:
        return list(range(count))
    try:
        numbers = [index(number) for number in logs]
    except TypeError:
        raise InputError(verb, "logs", logs, "log numbers (integers)") from None
    for number in numbers:
        if not 0 <= number < count:
            raise InputError(verb, "logs", number, f"numbers from 0 to {count - 1}")
    if not numbers:
        raise InputError(verb, "logs", "none", "at least one number")
    return numbers


ALL = "all"
"""In place of a joint's name: every joint that logs have columns of."""


@checked
def identify_joints(
    data: Named | Sequence[Named],
    method: Method = DEFAULT_METHOD,
    *,
    model: Named,
    of: str | Sequence[str] = ALL,
    root: Named | None = None,
    track: Track = untracked,
    description: Mapping[str, Any] | None = None,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Answer:
    """Identify several joints of a robot, one at a time, from logs with columns of all of them.

    The answer has a verdict for each joint, the worst first, and ``identifications`` by joint.

    Parameters
    ----------
    data
        A log file, a folder of logs, or a manifest whose logs may state their joint (``of``).
    method, track, options
        As in `identify`.
    model
        MJCF or URDF of the robot.
    of
        Names of joints; ``all`` for every one that a log is of.
    root
        Folder of the logs, if not the manifest's.
    description
        Further fields of a manifest, as `read` takes them: ``{"input": "torque"}``.

    Raises
    ------
    InputError
        No joint of the model has logs, or one that was asked for has none.
    """
    whole = manifest_of(data, root=root, **(description or {}))
    whole = whole.model_copy(update={"model": str(Path(model).absolute()), "of": None})
    by_joint = _logs_by_joint(whole, Path(model), of)
    answers: dict[str, Identification] = {}
    refused: dict[str, ButterflyError] = {}
    for joint, entries in track(by_joint.items(), "Identifying joints"):
        manifest = whole.model_copy(update={"of": joint, "logs": entries, "name": joint})
        try:
            logs = of_joint(read_data_set(with_model(manifest)))
            answers[joint] = identify(logs, method, **options)
        except ButterflyError as error:
            refused[joint] = error
    if not answers:
        raise next(iter(refused.values()))
    return _answer(whole, Path(model).name, answers, refused)


def _logs_by_joint(
    manifest: Manifest, model: Path, of: str | Sequence[str]
) -> dict[str, list[LogEntry]]:
    """Return the logs of each joint that is asked for: those that say so, or have its columns."""
    from butterfly.twin.joint_of_model import alike_joints, compiled, moving_joints  # noqa: PLC0415

    robot = compiled(model)[1]
    names = [*moving_joints(robot)]
    several = [of] if isinstance(of, str) else [*of]
    wanted = names if several == [ALL] else several
    for name in wanted:
        if name not in names:
            raise InputError(model, "joint", name, nearest(name, names) if names else "a joint")
    logs = logs_of_joints(manifest, {name: alike_joints(robot, name) for name in wanted})
    lacking = [name for name, entries in logs.items() if not entries]
    if several != [ALL] and lacking:
        expected = (
            f"logs in which they move, with columns named after {listed(lacking)}, or of: in the "
            "manifest"
        )
        raise InputError(manifest.name, "of", listed(lacking), expected)
    if len(lacking) == len(logs):
        expected = f"logs with columns named after one of {listed(names)}, or of: in the manifest"
        raise InputError(manifest.name, "of", "all", expected)
    return {name: entries for name, entries in logs.items() if entries}


def _answer(
    manifest: Manifest,
    model: str,
    answers: Mapping[str, Identification],
    refused: Mapping[str, ButterflyError],
) -> Answer:
    """Return the table of joints, the worst first."""
    order = [*Level].index
    worst = sorted(answers, key=lambda joint: -order(answers[joint].judged.level))
    ordered = {joint: answers[joint] for joint in worst}
    rows = [*map(_refused_row, refused), *map(_row, ordered, ordered.values())]
    verdict = Verdict.of_several({joint: answer.judged for joint, answer in ordered.items()})
    counts = {
        level.verdict: sum(answer.judged.level is level for answer in ordered.values())
        for level in (Level.GOOD, Level.CARE, Level.WARNING)
    }
    parts = [f"{count} {name}" for name, count in counts.items() if count]
    parts += [f"{len(refused)} without an answer"] if refused else []
    headers = ("joint", "verdict", "armature", "damping", "frictionloss", "FIT in %")
    lines = [_line(row) for row in rows]
    tables = [PageTable(f"Joints of {model}", headers, lines, caption=_UNITS)]
    for joint, answer in ordered.items():
        tables.append(values_table(joint, answer.estimate.table())._replace(detail=True))
        tables.append(model_table(answer)._replace(detail=True))
    facts = [Fact("joints", str(len(rows)), ", ".join(parts))]
    return Answer(
        kind="joints",
        title=f"{len(rows)} joints of {model}",
        summary=(
            *verdict.after(f"Joints of {model}: {', '.join(parts)}."),
            *(f"{joint}: {error}" for joint, error in refused.items()),
        ),
        judged=verdict,
        content={
            "data": {"name": manifest.name, "description": manifest.description, "model": model},
            "rows": rows,
            **views(tables, facts),
        },
        units={"rows.fit": "%"},
        identifications=ordered,
    )


def _row(joint: str, answer: Identification) -> dict[str, Any]:
    """Return what is known of a joint: values, and half-widths of their 95 % intervals."""
    known = {row.attribute: row for row in model_rows(answer)}
    values = {name: known[name].value if name in known else None for name in _ATTRIBUTES}
    widths = {f"{n}_half_width": known[n].half_width if n in known else None for n in _ATTRIBUTES}
    verdict = str(answer.standing)
    return {"joint": joint, "verdict": verdict, **values, **widths, "fit": answer.fit.median}


_UNITS = (
    "Armature in kg m², damping in N m s/rad, friction in N m (of a slide kg, N s/m, N), each with "
    "the half-width of its 95 % interval."
)
_ATTRIBUTES = ("armature", "damping", "frictionloss")
"""Attributes in the table of joints."""


def _refused_row(joint: str) -> dict[str, Any]:
    """Return the row of a joint without an answer."""
    nothing = dict.fromkeys([*_ATTRIBUTES, *(f"{name}_half_width" for name in _ATTRIBUTES), "fit"])
    return {"joint": joint, "verdict": "no answer", **nothing}


def _line(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a row as texts."""
    cells = (_cell(row, name) for name in _ATTRIBUTES)
    return row["joint"], row["verdict"], *cells, fit_text(row["fit"])


def _cell(row: Mapping[str, Any], name: str) -> str:
    """Return an attribute with its half-width."""
    value, half = row[name], row[f"{name}_half_width"]
    return "–" if value is None else with_limit(value, half if math.isfinite(half) else None)
