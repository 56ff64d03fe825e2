"""The runs of a sweep, each with the address of its result."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from butterfly import __version__
from butterfly.errors import InputError
from butterfly.experiment.sweeps import apply

if TYPE_CHECKING:
    from collections.abc import Iterator

    from butterfly.experiment.reading import Source
    from butterfly.experiment.schema import Experiment

FORMAT = 1
"""Of the results; another one gives other addresses."""

_NOT_ASKED = {"name", "description", "sweep", "report", "extends"}  # a result does not depend on it


@dataclass(frozen=True, kw_only=True)
class Task:
    """One run of a sweep: all that a worker needs, wherever it is.

    Parameters
    ----------
    number
        In the sweep's order, from 0 on.
    key
        Address of the result: a hash of the experiment with its defaults, the seed and the version.
    overrides
        Fields that this run sets, by their paths.
    repetition
        From 0 on.
    content
        The experiment's mapping, without its sweep.
    """

    number: int
    key: str
    overrides: dict[str, Any]
    repetition: int
    content: dict[str, Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class SweepPlan:
    """A sweep: the experiment it starts from, and its runs.

    Parameters
    ----------
    experiment
        The one without overrides.
    fields
        Paths of the fields that vary.
    tasks
        The runs, in order.
    """

    experiment: Experiment
    fields: tuple[str, ...]
    tasks: tuple[Task, ...]


def plan_sweep(source: Source) -> SweepPlan:
    """List the runs of an experiment file; one without ``sweep`` has one.

    Every run is validated here, so that a slip shows before anything is simulated.

    Raises
    ------
    InputError
        If the file, or a variation of it, does not follow the schema.
    """
    experiment = source.experiment()
    sweep = experiment.sweep
    if sweep is None:
        plain = _task(0, {}, 0, source.content, experiment)
        return SweepPlan(experiment=experiment, fields=(), tasks=(plain,))
    for field in sweep.fields:
        if field.split(".")[0] in {"sweep", "extends", "name"}:
            raise InputError(source.path, f"sweep: {field}", field, "a field of the experiment")
    return SweepPlan(
        experiment=experiment, fields=tuple(sweep.fields), tasks=tuple(_tasks(source, experiment))
    )


def _tasks(source: Source, experiment: Experiment) -> Iterator[Task]:
    assert experiment.sweep is not None  # noqa: S101 - or there would be one task
    base = {key: value for key, value in source.content.items() if key != "sweep"}
    for number, (overrides, repetition, seed) in enumerate(
        experiment.sweep.points(experiment.seed)
    ):
        content = apply(base, {"seed": seed} | overrides, source.path)
        yield _task(number, overrides, repetition, content, source.experiment(content))


def _task(
    number: int,
    overrides: dict[str, Any],
    repetition: int,
    content: dict[str, Any],
    experiment: Experiment,
) -> Task:
    # Without defaults, so that a field which is added to the schema leaves old addresses alone.
    asked = experiment.model_dump(mode="json", exclude=_NOT_ASKED, exclude_defaults=True)
    text = json.dumps([FORMAT, __version__, asked], sort_keys=True)
    return Task(
        number=number,
        key=hashlib.sha256(text.encode()).hexdigest()[:24],
        overrides=overrides,
        repetition=repetition,
        content=content,
    )
