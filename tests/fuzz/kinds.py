"""The kinds of files that are damaged: what they are when sound, and how they are read."""

from collections.abc import Callable
from functools import cache
from importlib.util import find_spec

from tests.fuzz import answers, files, results, values

KINDS = (
    *("mat", "csv", "parquet", "json", "experiment", "manifest"),
    *("results", "saved", "values"),
)
KINDS += answers.KINDS
KINDS += ("mcap",) if find_spec("mcap_ros2") else ()
KINDS += ("strangers",) if find_spec("matio") else ()
"""Their names."""


@cache
def sounds_of(kind: str) -> list[files.Sound]:
    """Return sound contents of a kind, each with what tells what escapes of a damaged one."""
    made: dict[str, Callable[[], list[files.Sound]]] = {
        "mcap": files.bags,
        "strangers": files.strangers,
        "experiment": lambda: [(each, files.experiment_escapes) for each in files.EXPERIMENTS],
        "manifest": lambda: [(each, files.manifest_escapes) for each in files.MANIFESTS],
        "results": results.sounds,
        "saved": lambda: [(results.saved(), results.saved_escapes)],
        "values": lambda: [(bytes(range(32)), values.escapes)],
    }
    if kind in answers.KINDS:
        return answers.sounds(kind)
    return made[kind]() if kind in made else files.logs(kind)
