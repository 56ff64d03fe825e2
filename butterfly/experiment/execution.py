"""Do one run of a sweep: simulate, identify, compare with the truth. Runs on any worker."""

from __future__ import annotations

import math
import platform
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
import scipy

from butterfly import __version__
from butterfly.errors import ButterflyError
from butterfly.experiment.orbit import hold_orbit
from butterfly.experiment.runner import entry_of, manifest_of
from butterfly.experiment.schema import Experiment
from butterfly.identify.data import DataSet
from butterfly.identify.predict import FitSummary, Predictor
from butterfly.identify.validation import hold_out
from butterfly.logs.manifest import MANIFEST_NAME, manifest_text
from butterfly.logs.parquet import parquet_bytes
from butterfly.plant.sweep import sweep

if TYPE_CHECKING:
    from butterfly.experiment.plan import Task
    from butterfly.identify.estimate import ParameterEstimate
    from butterfly.identify.estimators import Estimator
    from butterfly.model.parameters import LumpedParameters

OK, REFUSED, FAILED = "ok", "refused", "failed"
"""A run's status: done, refused for good (bad input, unidentifiable), or failed unexpectedly."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a run gave.

    Parameters
    ----------
    record
        For its JSON file: status, seed, estimates, versions, times.
    files
        Contents of the files that go beside it, by name.
    """

    record: dict[str, Any]
    files: dict[str, bytes] = field(default_factory=dict)


def execute(task: Task) -> Outcome:
    """Do one run; whatever goes wrong is recorded, so that the sweep goes on."""
    begun = time.perf_counter()
    experiment = Experiment.model_validate(task.content)
    record: dict[str, Any] = {
        "key": task.key,
        "status": OK,
        "error": "",
        "seed": experiment.seed,
        "overrides": task.overrides,
        "repetition": task.repetition,
        "estimates": [],
        "versions": versions(),
    }
    files: dict[str, bytes] = {}
    try:
        _simulate_and_identify(experiment, record, files)
    except ButterflyError as error:
        record |= {"status": REFUSED, "error": str(error)}
    except Exception as error:
        record |= {"status": FAILED, "error": f"{type(error).__name__}: {error}"}
    record["seconds"] = record.get("seconds", {}) | {"total": time.perf_counter() - begun}
    return Outcome(record=record, files=files)


def versions() -> dict[str, str]:
    """Return what the result was made with."""
    return {
        "butterfly": __version__,
        "mujoco": mujoco.__version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": platform.python_version(),
    }


def _simulate_and_identify(
    experiment: Experiment, record: dict[str, Any], files: dict[str, bytes]
) -> None:
    begun = time.perf_counter()
    runs = experiment.runs()
    truth = experiment.plant.robot.lumped
    data = None
    if runs:
        setup, seeds = experiment.plant.setup, experiment.seeds()
        logs = list(sweep(setup, runs, experiment.duration, seeds, threads=1))
        simulated = time.perf_counter()
        record["seconds"] = {"simulate": simulated - begun}
        if experiment.keep_signals:
            entries = [entry_of(log, "parquet") for log in logs]
            for entry, log in zip(entries, logs, strict=True):
                files[entry.file] = parquet_bytes(log)
            files[MANIFEST_NAME] = manifest_text(manifest_of(experiment, entries)).encode()
        data = DataSet.of(logs, name=experiment.name)
        record["logs"] = len(logs)
        for spec in experiment.all_estimators:
            record["estimates"].append(_estimate(data, spec, experiment, truth))
        record["seconds"]["identify"] = time.perf_counter() - simulated
    if experiment.control is not None:
        record["orbit"] = hold_orbit(experiment, data).numbers()


def _estimate(
    data: DataSet, spec: Estimator, experiment: Experiment, truth: LumpedParameters
) -> dict[str, Any]:
    """Return an estimator's result, or what it refused, for the record."""
    row: dict[str, Any] = {"method": spec.label, "error": ""}
    try:
        found = spec(data)
    except ButterflyError as error:
        return row | {"error": str(error)}
    fit = FitSummary.of(Predictor(data).fits(found))
    row |= {
        "fit": {"median": fit.median, "mean": fit.mean, "worst": fit.worst},
        "condition": found.condition,
        "parameters": _rows(found, truth),
    }
    if experiment.validation is not None:
        try:
            held = hold_out(data, spec.unchecked(), experiment.validation.split)
        except ButterflyError as error:
            return row | {"error": f"nothing could be left out: {error}"}
        row["held_out"] = {"median": held.summary.median, "worst": held.summary.worst}
    return row


def _rows(found: ParameterEstimate, truth: LumpedParameters) -> list[dict[str, Any]]:
    columns = zip(
        found.names,
        found.values.tolist(),
        found.standard_errors.tolist(),
        found.lower.tolist(),
        found.upper.tolist(),
        strict=True,
    )
    return [
        {
            "parameter": name,
            "value": value,
            "standard_error": _or_none(error),
            "lower": _or_none(lower),
            "upper": _or_none(upper),
            "true": float(getattr(truth, name)),
        }
        for name, value, error, lower, upper in columns
    ]


def _or_none(value: float) -> float | None:
    """JSON has no NaN."""
    return value if math.isfinite(value) else None
