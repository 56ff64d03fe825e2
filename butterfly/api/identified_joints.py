"""Each joint of a robot, identified by itself from the logs that have its columns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from butterfly.api.identification import Identification
from butterfly.api.joint_models import drives, of_joint, with_model
from butterfly.api.sources import Named, manifest_of
from butterfly.api.verbs import Method, identify
from butterfly.arguments import checked
from butterfly.errors import ButterflyError, InputError, listed, nearest
from butterfly.identification.data import read_data_set
from butterfly.identification.estimators import DEFAULT_METHOD
from butterfly.logs.manifest import LogEntry, Manifest
from butterfly.progress import Track, untracked
from butterfly.report.format import fit_text
from butterfly.report.model_table import model_table
from butterfly.report.page import Fact, PageTable, views
from butterfly.report.parameter_table import values_table, with_limit
from butterfly.result import Answer
from butterfly.twin.model_rows import model_rows
from butterfly.verdict import Level, Verdict

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
    from butterfly.twin.joint_of_model import compiled, moving_joints  # noqa: PLC0415 - slow

    names = [*moving_joints(compiled(model)[1])]
    several = [of] if isinstance(of, str) else [*of]
    wanted = names if several == [ALL] else several
    for name in wanted:
        if name not in names:
            raise InputError(model, "joint", name, nearest(name, names) if names else "a joint")
    logs = {name: [e for e in manifest.logs if drives(manifest, e, name, names)] for name in wanted}
    lacking = [name for name, entries in logs.items() if not entries]
    if several != [ALL] and lacking:
        expected = f"logs with columns named after {listed(lacking)}, or of: in the manifest"
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
