"""Damaged CSV files, experiments and manifests, as the readers take them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from butterfly.experiment.source import Source
from butterfly.experiment.sweep import plan_sweep
from butterfly.files import shipped
from butterfly.identification.data import read_data_set
from butterfly.logs.csv import read_csv
from butterfly.logs.log import InputKind
from butterfly.logs.manifest import read_manifest
from butterfly.model.parameters import AddedMass
from tests.fuzz.escape import escape_of

if TYPE_CHECKING:
    from pathlib import Path

_TIME = np.arange(30) * 0.01
_ROWS = "".join(f"{t:.2f},{np.sin(t):.6f},{np.cos(t):.6f}\n" for t in _TIME)
CSV = [
    ("time,input,angle\n" + _ROWS).encode(),
    ("# a log\ntime;input;angle\n" + _ROWS.replace(",", ";").replace(".", ",")).encode("utf-16"),
    ("time [s]\tinput [V]\tangle [rad]\n" + _ROWS.replace(",", "\t")).encode("latin-1"),
]
_SWEEP = b"""\
extends: quickstart
name: sweep
keep_signals: true
sweep:
  grid: {duration: [20, 3e1], plant.hand.mass: [0.1, 0.12]}
  list: [{method: linear}, {method: auto, terms: [coulomb]}]
  random: {count: 2, fields: {plant.friction.coulomb: {log_uniform: [1e-5, 1e-3]}}}
  latin_hypercube: {count: 2, fields: {seed: {choice: [1, 2]}}}
  repetitions: 2
"""
EXPERIMENTS = [
    _SWEEP,
    *(
        shipped(f"experiments/{name}.yaml").read_bytes()
        for name in ("quickstart", "friction-zoo", "orbit-recalibration", "mjcf-vs-greybox")
    ),
]
_MANIFEST = b"""\
name: bench
input: torque
arm: 0.104
known: {p4: 1, p3: {value: 0.3, uncertainty: 0.01}, resistance: 2.3}
units: {time: ms, angle: counts/4096}
columns: {time: t, input: u, angle: q}
repair: [backward]
zeros: [{added_mass: 0, zero: 0.1}]
holdout: [b.csv]
logs:
  - {file: a.csv, added_mass: 0, omega: 4, amplitude: 0.1, from: 1.0, to: 20}
  - {file: b.csv, added_mass: 0.05, split: restarts}
"""
MANIFESTS = [shipped("experiments/real-logs.yaml").read_bytes(), _MANIFEST]


def csv_escapes(content: bytes, path: Path) -> str:
    """Read a table, and tell what is neither a log nor a line."""
    path = _written(content, path.with_suffix(".csv"))
    kind = {"input_kind": InputKind.VOLTAGE, "added_mass": AddedMass()}
    return escape_of(lambda: read_csv(path, **kind))


def experiment_escapes(content: bytes, path: Path) -> str:
    """Read an experiment and plan its runs, and tell what is neither done nor a line."""
    path = _written(content, path.with_suffix(".yaml"))

    def planned() -> object:
        plan = plan_sweep(Source(path))
        return plan.experiment.runs(), plan.tasks

    return escape_of(planned)


def manifest_escapes(content: bytes, path: Path) -> str:
    """Read a manifest and the logs it names, and tell what is neither done nor a line."""
    path = _written(content, path.with_suffix(".yaml"))
    return escape_of(lambda: read_data_set(read_manifest(path, path.parent)))


def _written(content: bytes, path: Path) -> Path:
    path.write_bytes(content)
    return path
