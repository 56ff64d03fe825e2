"""Damaged CSV files, experiments and manifests, as the readers take them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from butterfly.experiment.reading import read_experiment
from butterfly.logs.csv import read_csv
from butterfly.logs.log import InputKind
from butterfly.logs.manifest import read_manifest
from butterfly.model.parameters import AddedMass
from butterfly.resources import shipped
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
EXPERIMENTS = [shipped("experiments/quickstart.yaml").read_bytes()]
MANIFESTS = [shipped("experiments/real-logs.yaml").read_bytes()]


def csv_escapes(content: bytes, path: Path) -> str:
    """Read a table, and tell what is neither a log nor a line."""
    path = _written(content, path.with_suffix(".csv"))
    kind = {"input_kind": InputKind.VOLTAGE, "added_mass": AddedMass()}
    return escape_of(lambda: read_csv(path, **kind))


def experiment_escapes(content: bytes, path: Path) -> str:
    """Read an experiment and plan it, and tell what is neither done nor a line."""
    path = _written(content, path.with_suffix(".yaml"))
    return escape_of(lambda: read_experiment(path).runs())


def manifest_escapes(content: bytes, path: Path) -> str:
    """Read a manifest, and tell what is neither done nor a line."""
    path = _written(content, path.with_suffix(".yaml"))
    return escape_of(lambda: read_manifest(path))


def _written(content: bytes, path: Path) -> Path:
    path.write_bytes(content)
    return path
