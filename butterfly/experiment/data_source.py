"""Whatever a user names as data: a log, a folder, a manifest, a shipped name, a result."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from butterfly.errors import InputError, require_number
from butterfly.files import locate
from butterfly.identification.data import DataSet, read_data_set
from butterfly.logs.column_map import ColumnMap
from butterfly.logs.drafted import manifest_from_names, manifest_of_files, manifest_of_log
from butterfly.logs.formats import ENDINGS, FORMATS
from butterfly.logs.health import Repair
from butterfly.logs.log import InputKind, Intersample
from butterfly.logs.manifest import MANIFEST_NAME, Manifest, read_manifest
from butterfly.logs.pieces import WHOLE, Cut
from butterfly.logs.units import Units
from butterfly.model.known import NOTHING, Knowledge, Known
from butterfly.model.parameters import JointKind
from butterfly.progress import Track, untracked
from butterfly.yaml_input import load_yaml

_OF_EXPERIMENTS = {"plant", "extends", "sweep"}  # keys that no manifest has

_YAML = {".yaml", ".yml"}

RESULT = ".json"
"""Ending of a saved result."""


def named_data(
    source: Path,
    *,
    root: Path | None = None,
    arm: float | None = None,
    input_kind: InputKind = InputKind.VOLTAGE,
    intersample: Intersample = Intersample.ZERO_ORDER_HOLD,
    columns: ColumnMap | None = None,
    units: Mapping[str, str | float] | None = None,
    repair: Collection[Repair] = (),
    known: Knowledge = NOTHING,
    zero: Known | None = None,
    joint: JointKind | None = None,
    gravity: float | None = None,
    cut: Cut = WHOLE,
    track: Track = untracked,
) -> DataSet:
    """Read the data that a user named (see `manifest_of`), of a robot of which more is known."""
    manifest = manifest_of(
        source,
        root=root,
        arm=arm,
        input_kind=input_kind,
        intersample=intersample,
        columns=columns,
        units=units,
        repair=repair,
    )
    told = manifest.moving(joint, gravity).knowing(known).with_zero(zero)
    return read_data_set(cut.of(told), track)


def manifest_of(
    source: Path,
    *,
    root: Path | None = None,
    arm: float | None = None,
    input_kind: InputKind = InputKind.VOLTAGE,
    intersample: Intersample = Intersample.ZERO_ORDER_HOLD,
    columns: ColumnMap | None = None,
    units: Mapping[str, str | float] | None = None,
    repair: Collection[Repair] = (),
    loose: bool = False,
) -> Manifest:
    """Describe the data that a user named, as a manifest.

    Parameters
    ----------
    source
        A manifest; a folder with one, or with logs named like Data_52__8__002.mat; a log; a saved
        result; or the name of a shipped data set.
    root
        Folder of the logs, if not the one that the manifest names.
    arm
        Pivot to added mass in m, where no manifest says it.
    input_kind, intersample
        What the input commands, and how it is held, where no manifest says so.
    columns, units, repair
        What holds time, input and angle; units of the columns (see `butterfly.logs.units`); repairs
        that may be made: in place of, or besides, what a manifest says.
    loose
        Whether a folder without a manifest may hold logs of any names, to which nothing was added.

    Raises
    ------
    InputError
        If ``source`` is none of these, or cannot be read.
    """
    if arm is not None:
        require_number("data", unit="m", arm=arm)
    if columns is not None and not isinstance(columns, Mapping):
        raise InputError("data", "columns", columns, "a mapping such as {'time': 't', ...}")
    Units.told(units, "data")
    about: dict[str, Any] = {"arm": arm, "input_kind": input_kind, "intersample": intersample}
    path = locate(source)
    said = {**about, "units": dict(units or {})}
    if loose and path.is_dir() and not (path / MANIFEST_NAME).exists():
        _refuse_sweep(path)
        told = manifest_of_files(path, **said)
    else:
        told = _described(path, root, said)
    more = {"units": {**told.units, **(units or {})}, "repair": told.repair | frozenset(repair)}
    changed = more if columns is None else {**more, "columns": dict(columns)}
    return told.model_copy(update=changed)


def _described(path: Path, root: Path | None, about: Mapping[str, Any]) -> Manifest:
    """Return the manifest of data, or draft one, of which ``about`` says what else is known."""
    if path.is_dir():
        if (path / MANIFEST_NAME).exists():
            return read_manifest(path / MANIFEST_NAME, root)
        _refuse_sweep(path)
        if about["arm"] is None:
            expected = (
                "a manifest, or --arm and files named like Data_52__8__002.mat "
                "(`butterfly manifest FOLDER` drafts one)"
            )
            raise InputError(path, MANIFEST_NAME, "no such file", expected)
        return manifest_from_names(path, **about)
    if path.suffix.lower() in FORMATS:
        beside = path.parent / MANIFEST_NAME
        listed = _entry_of(path, beside, root) if beside.exists() else None
        return listed or manifest_of_log(path, **about)
    if path.suffix == RESULT:
        return _saved_manifest(path, root)
    if path.suffix.lower() not in _YAML:
        expected = f"{ENDINGS}, a manifest (.yaml), or a saved result ({RESULT})"
        raise InputError(path, "file name", path.suffix or "no ending", expected)
    try:
        return read_manifest(path, root)
    except InputError:
        _refuse_experiment(path)
        raise


def _entry_of(path: Path, beside: Path, root: Path | None) -> Manifest | None:
    """Return the part of a manifest that describes one of its files, if it does."""
    manifest = read_manifest(beside, root)
    root_folder, wanted = Path(manifest.root), path.resolve()
    own = [entry for entry in manifest.logs if (root_folder / entry.file).resolve() == wanted]
    return manifest.model_copy(update={"logs": own, "name": path.name}) if own else None


def _refuse_sweep(folder: Path) -> None:
    from butterfly.experiment.store import SWEEP  # noqa: PLC0415 - slow to import

    if (folder / SWEEP).exists():
        logs = sorted(path.parent for path in folder.glob(f"runs/*/*/{MANIFEST_NAME}"))
        which = f"the logs of one run, as {logs[0]}" if logs else "results with keep_signals: true"
        raise InputError(folder, "data", "the results of a sweep", which)


def _refuse_experiment(path: Path) -> None:
    said = load_yaml(path).content.keys()
    if "logs" not in said and said & _OF_EXPERIMENTS:
        expected = f"data, as `butterfly run {path.name}` makes them in results/"
        raise InputError(path, "data", "an experiment", expected)


def _saved_manifest(path: Path, root: Path | None) -> Manifest:
    """Return what a saved identification knows of its data."""
    expected = "an identification that butterfly saved"
    try:
        found = json.loads(path.read_text(encoding="utf-8"))["data"]["manifest"]
        told = found and found["root"]
        manifest = found and Manifest.model_validate({**found, "root": told or "."})
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        raise InputError(path, "data.manifest", "none that can be used", expected) from None
    if manifest is None:
        expected = "one whose logs came from one source of files, to be read again"
        raise InputError(path, "data.manifest", "none", expected)
    if told is None and root is None:
        expected = "--root, the folder of the logs: this result does not say where they lie"
        raise InputError(path, "data.manifest.root", "nothing", expected)
    folder = root_of(path, manifest.root, root)
    if not folder.is_dir():
        raise InputError(path, "data.manifest.root", folder, "the folder of the logs, or --root")
    return manifest.model_copy(update={"root": str(folder)})


def root_of(path: Path, said: str, root: Path | None = None) -> Path:
    """Return the folder of the logs of which a result in a file says that they lie in ``said``.

    Parameters
    ----------
    path
        The file.
    said
        Absolute, or relative to the file's folder.
    root
        Where they lie instead, if they were moved.
    """
    return (path.parent / said).resolve() if root is None else root.absolute()


def is_data(path: Path) -> bool:
    """Whether a path is one of data; a file that is no YAML is left to its reader to refuse."""
    if path.is_dir() or path.suffix.lower() in {*FORMATS, RESULT}:
        return True
    try:
        return "logs" in load_yaml(path).content
    except InputError:
        return False
