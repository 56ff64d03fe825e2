"""Files that are read: what they are when sound, and what escapes of damaged ones."""

import io
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from butterfly.experiment.source import Source
from butterfly.experiment.sweep import plan_sweep
from butterfly.files import shipped
from butterfly.identification.data import read_data_set
from butterfly.logs.formats import read_log
from butterfly.logs.log import InputKind
from butterfly.logs.manifest import read_manifest
from butterfly.model.parameters import AddedMass
from tests.fuzz.escape import escape_of
from tests.independent.readers import WRITERS
from tests.logs.written import write_bag, write_objects, write_sheets

Sound = tuple[bytes, Callable[[bytes, Path], str]]
"""Content of a sound file, and what tells what escapes of a damaged one."""

_FILES = 20  # of each format
_KIND: dict[str, Any] = {"input_kind": InputKind.VOLTAGE, "added_mass": AddedMass()}
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


def logs(kind: str) -> list[Sound]:
    """Return random logs of a format."""
    rng = np.random.default_rng(15)
    found: list[Sound] = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(_FILES):
            columns, _, path = WRITERS[kind](rng, Path(folder) / str(number))
            found.append((path.read_bytes(), partial(log_escapes, path.suffix, columns)))
    return found


def bags() -> list[Sound]:
    """Return ROS 2 bags of a joint, packed and not."""
    from mcap.writer import CompressionType  # noqa: PLC0415 - an extra

    columns = np.random.default_rng(15).standard_normal((3, 40, 1))
    parts = dict(zip(("effort", "position", "velocity"), columns, strict=True))
    files = [io.BytesIO() for _ in CompressionType]
    for file, packed in zip(files, CompressionType, strict=True):
        write_bag(file, range(0, 40 * 10**7, 10**7), parts, compression=packed)
    return [(file.getvalue(), partial(log_escapes, ".mcap", None)) for file in files]


def strangers() -> list[Sound]:
    """Return NumPy's and Excel's files, and MATLAB's objects, packed and not."""
    values = np.random.default_rng(15).standard_normal((40, 3))
    columns = pd.DataFrame(values, columns=["time", "input", "angle"])
    told = {"T": columns, "u": (values[:, 1], "V", values[:, 0])}
    mapped = {"time": "u.Time", "input": "u.Data", "angle": "T.angle"}
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"a.{each}" for each in ("npz", "npy", "xlsx", "mat", "73.mat")]
        np.savez_compressed(paths[0], **columns, units="s, V, rad")
        np.save(paths[1], values)
        write_sheets(paths[2], {"a": [[*columns], *values.tolist()]})
        write_objects(paths[3], told, "v7", packed=False)
        write_objects(paths[4], told, "v7.3")
        pairs = zip(paths, [None, None, None, mapped, mapped], strict=True)
        return [(p.read_bytes(), partial(log_escapes, p.suffix, each)) for p, each in pairs]


def log_escapes(ending: str, columns: dict[str, Any] | None, content: bytes, path: Path) -> str:
    """Read a log, and tell what is neither a log nor a line."""
    path = _written(content, path.with_suffix(ending))
    return escape_of(lambda: read_log(path, columns, **_KIND))


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
