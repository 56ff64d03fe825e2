"""The kinds of files that are damaged: what they are when sound, and how they are read."""

from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from tests.fuzz import files, results, values

Sound = tuple[bytes, Callable[[bytes, Path], str]]

KINDS = (
    "mat",
    "csv",
    "parquet",
    "experiment",
    "manifest",
    "results",
    "saved",
    "values",
    "json",
)
KINDS += ("mcap",) if find_spec("mcap_ros2") else ()
"""Their names."""


@cache
def sounds_of(kind: str) -> list[Sound]:
    """Return sound contents of a kind, each with what tells what escapes of a damaged one."""
    if kind == "results":
        return results.sounds()
    contents, escapes = {
        "mat": lambda: (files.mats(), files.mat_escapes),
        "csv": lambda: (files.CSV, files.csv_escapes),
        "parquet": lambda: (files.parquets(), files.parquet_escapes),
        "mcap": lambda: (files.bags(), files.mcap_escapes),
        "json": lambda: (files.JSON, files.json_escapes),
        "experiment": lambda: (files.EXPERIMENTS, files.experiment_escapes),
        "manifest": lambda: (files.MANIFESTS, files.manifest_escapes),
        "saved": lambda: ([results.saved()], results.saved_escapes),
        "values": lambda: ([bytes(range(32))], values.escapes),
    }[kind]()
    return [(content, escapes) for content in contents]
