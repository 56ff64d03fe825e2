"""Whatever holds logs or an experiment, read."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias, TypeGuard

from butterfly.api.joint_models import of_joint, with_model
from butterfly.arguments import checked
from butterfly.errors import InputError
from butterfly.files import locate, refuse_binary, require_as_signed
from butterfly.identification.data import DataSet, read_data_set
from butterfly.identification.identified import Identified
from butterfly.logs.formats import (
    ENDINGS,
    FORMATS,
    OFTEN_OTHERS,
    Table,
    holds_table,
    is_table,
    log_of_table,
)
from butterfly.logs.health import DEFAULT_REPAIRS
from butterfly.logs.log import Log
from butterfly.logs.manifest import (
    MANIFEST_NAME,
    LogEntry,
    Manifest,
    Recordings,
    checked_options,
    described,
    read_manifest,
    require_columns,
)
from butterfly.logs.reading import draft, log_files, of_logs, pieces_of
from butterfly.model.prior import NO_PRIOR, Prior, known_of
from butterfly.progress import Track, untracked
from butterfly.result import SWEEP
from butterfly.yaml_files import load_yaml

RESULT_ENDING = ".json"
"""Ending of a saved result."""

_OF_EXPERIMENTS = {"plant", "extends", "sweep"}  # keys that no manifest has
_OF_LOGS = re.compile(
    rb'\s*(?:\[\s*[\[{]|\{\s*"(?!schema"\s*:\s*"|data"\s*:\s*[^\[\s]))'
)  # no result's
_BEGINNING = 4096  # bytes
_OF_RESULT = b'"schema": "butterfly.'
_YAML = {".yaml", ".yml"}
_PATTERN = frozenset("*?[")
_OF_FOLDERS = (
    "name",
    "description",
    "root",
    "logs",
    "model",
)  # what manifests of the same facts differ in
_OF_READ_LOGS = {"known", "zero", "repair", "name"}  # what may be given of logs that are read
_READ = (DataSet, Identified, Log)

Named: TypeAlias = str | PathLike[str]
"""A path, a glob pattern, or the name of something shipped."""

One: TypeAlias = DataSet | Identified | Log | Named | Table
"""Whatever holds logs by itself."""

Data: TypeAlias = One | Sequence[One]
"""Whatever `read` takes."""


@checked
def read(
    source: Data,
    *,
    root: Named | None = None,
    track: Track = untracked,
    **description: Any,  # noqa: ANN401 - fields of the manifest
) -> DataSet:
    """Read and check logs, repair their clocks, and fit the steady response of sines.

    Parameters
    ----------
    source
        A log file, a folder of logs, a manifest, a glob pattern, a saved result, or a shipped data
        set's name; a `Log`, `DataSet` or `Identification`; a pandas frame, a mapping of arrays, or
        an array with named columns or the columns t, u, q[, dq]; or a list of these.
    root
        Folder of the logs, if not the manifest's.
    track
        Progress callback.
    description
        Fields of a manifest (see `Manifest`). If none gives them: ``arm``, ``input``,
        ``intersample``. In place of its own: ``name``, ``columns``, ``joint``, ``gravity``,
        ``sign``, ``zero``, ``interval``. Added to its own: ``units``, such as ``{"time": "ms"}``;
        ``known``, such as ``{"p4": (1.0, 0.02)}``; ``model`` and ``of``: MJCF or URDF of a robot,
        and its joint that moved; ``pose`` of its others; ``loop``, such as ``{"law": "dynamixel-x",
        "kp": 400}``; ``repair``; ``holdout``. Also ``piece``: start and end in s of the section to
        use, such as ``(1.5, None)``; ``restarts``: split a file where its clock restarts.
    """
    folder, given = None if root is None else Path(root), _given(description)
    holdout = given.pop("holdout", [])
    several = isinstance(source, Sequence) and not isinstance(source, str)
    sources: Sequence[Any] = source if several else [source]  # type: ignore[assignment]
    if all(isinstance(origin, str | PathLike) for origin in sources):
        return _of_files(sources, folder, given, track).holding_out(holdout)
    if all(isinstance(origin, _READ) for origin in sources):
        for name, value in {"root": folder, **given}.items():
            if value is not None and name not in _OF_READ_LOGS:
                raise InputError("read", name, value, "no such option: these logs are already read")
    first, *others = parts = [_part(origin, folder, given, track) for origin in sources]
    if others or isinstance(first, Log):
        label = first.name if isinstance(first, Log) and not several else ""
        data = _union(parts, {"name": label or "logs", **given})
    else:
        if isinstance(sources[0], _READ) and given.get("repair"):
            listed = ", ".join(sorted(given["repair"]))
            raise InputError("read", "repair", listed, "no repair: these logs are already read")
        data = _more_known(replace(first, name=given.get("name", first.name)), given)
    return data.holding_out(holdout)


def manifest_of(
    source: Named | Sequence[Named],
    *,
    root: Named | None = None,
    massless: bool = False,
    **description: Any,  # noqa: ANN401 - as `read` takes it
) -> Manifest:
    """Return one manifest of all files that `read` would read; ``massless`` as in `draft`."""
    folder, given = None if root is None else Path(root), _given(description)
    sources = [source] if isinstance(source, str | PathLike) else source
    manifests = _manifests(sources, folder, given, massless=massless)
    whole = _joined(manifests, given)
    if whole is None:
        raise InputError("data", "source", f"{len(manifests)} manifests", "files of one manifest")
    return whole


def require_said(path: Path, manifest: Manifest) -> None:
    """Raise InputError if a written manifest of a path leaves a column unspecified."""
    neighbour = (path if path.is_dir() else path.parent) / MANIFEST_NAME
    file = path if path.suffix.lower() in _YAML else neighbour
    if file.exists():
        require_columns(file, manifest)


def _given(description: Mapping[str, Any]) -> dict[str, Any]:
    """Return keywords as fields of a manifest, and ``from`` and ``to``."""
    some = {name: value for name, value in description.items() if value is not None}
    if "input_kind" in some:
        some["input"] = some.pop("input_kind")
    if "model" in some:
        some["model"] = str(Path(some["model"]).absolute())
    if some.pop("restarts", False):
        some["split"] = Recordings.RESTARTS
    if "piece" in some:
        piece = some.pop("piece")
        if not isinstance(piece, Sequence) or len(piece) != 2:  # noqa: PLR2004 - from and to
            raise InputError("data", "piece", piece, "start and end time in s, such as (1.5, None)")
        some["from"], some["to"] = piece
    return checked_options(some)


def _part(source: One, root: Path | None, given: Mapping[str, Any], track: Track) -> DataSet | Log:
    """Return the data of a source; ``given`` describes one that is not yet read."""
    if isinstance(source, DataSet | Log):
        return source
    if isinstance(source, Identified):
        return source.data
    if isinstance(source, str | PathLike):
        return _of_files([source], root, given, track)
    if is_table(source):
        return _of_table(source, root, given)
    expected = "a path, a name, logs, a table, or a list of these"
    raise InputError("read", "source", type(source).__name__, expected)


def _more_known(data: DataSet, given: Mapping[str, Any]) -> DataSet:
    data = data.knowing(Prior.of(given.get("known", {})))
    return data.with_zero(known_of(given["zero"])) if "zero" in given else data


def _of_table(table: Table, root: Path | None, given: Mapping[str, Any]) -> DataSet:
    """Return the data set of a table; options of files are refused."""
    for name, value in (("root", root), ("arm", given.get("arm"))):
        if value is not None:
            expected = "no such option with a table; use bf.Log and its added_mass"
            raise InputError("read", name, value, expected)
    manifest = of_logs("logs", Path(), [LogEntry(file="table")], given)
    manifest = manifest.piece(given.get("from"), given.get("to"))
    entry = manifest.logs[0]
    log = log_of_table(table, manifest.columns, manifest.scale(entry), **manifest.properties(entry))
    return DataSet.of(
        [piece for _, piece in pieces_of(manifest, entry, log)],
        name=manifest.name,
        known=manifest.prior,
        repairs=manifest.repair,
    )


def _of_files(
    sources: Sequence[Named], root: Path | None, given: Mapping[str, Any], track: Track
) -> DataSet:
    """Return the data set of files, with one manifest if their manifests agree."""
    manifests = _manifests(sources, root, given)
    for path, manifest in zip(_paths(sources), manifests, strict=True):
        require_said(path, manifest)
    whole = _joined(manifests, given)
    wanted = [with_model(manifest) for manifest in ([whole] if whole else manifests)]
    parts = [of_joint(read_data_set(manifest, track)) for manifest in wanted]
    if whole is not None:
        return parts[0]
    return _union(parts, {"name": "logs", **given})


def _union(parts: Sequence[DataSet | Log], given: Mapping[str, Any]) -> DataSet:
    """Return one data set of all logs, with every source's repairs.

    InputError if one is of a robot's model, whose facts and corrections stand in its manifest.
    """
    named = [part.manifest for part in parts if isinstance(part, DataSet) and part.manifest]
    for manifest in named:
        if manifest.model is not None:
            got = f"one for {manifest.name}, and other descriptions beside it"
            expected = "one manifest with all logs; what differs, such as pose, is said of each log"
            raise InputError("read", "model", got, expected)
    logs: list[Log] = []
    test_logs: list[Log] = []
    known = NO_PRIOR
    repairs = DEFAULT_REPAIRS | given.get("repair", frozenset())
    for part in parts:
        if isinstance(part, Log):
            logs.append(part)
            continue
        known = known.agreeing(part.given, part.name)
        logs.extend(part.recorded)
        test_logs.extend(() if part.test_logs is None else part.test_logs.recorded)
        if part.manifest is not None:
            repairs |= part.manifest.repair
    data = DataSet.of([*logs, *test_logs], name=given["name"], known=known, repairs=repairs)
    return _more_known(data, given).holding(range(len(logs), len(data.logs)))


def _joined(manifests: Sequence[Manifest], given: Mapping[str, Any]) -> Manifest | None:
    """Return one manifest of all logs; None if the manifests disagree."""
    first = manifests[0]
    if len(manifests) == 1:
        return first
    facts = [manifest.model_dump(exclude={*_OF_FOLDERS}) for manifest in manifests]
    if any(fact != facts[0] for fact in facts):
        return None
    root = Path(os.path.commonpath([manifest.root for manifest in manifests]))
    entries = [
        entry.model_copy(
            update={"file": (Path(manifest.root) / entry.file).relative_to(root).as_posix()}
        )
        for manifest in manifests
        for entry in manifest.logs
    ]
    header = {"name": given.get("name", "logs"), "description": ""}
    return first.model_copy(update={**header, "root": str(root), "logs": entries})


def _paths(sources: Sequence[Named]) -> list[Path]:
    """Return the given paths, with glob patterns expanded."""
    paths: list[Path] = []
    for source in sources:
        if not str(source):
            raise InputError("read", "source", "empty", "a path or a name")
        path = Path(source)
        if path.exists() or not _PATTERN & set(str(source)):
            paths.append(locate(path))
            continue
        base = Path(path.anchor) if path.is_absolute() else Path()
        matching = sorted(base.glob(str(path.relative_to(base))))
        if not matching:
            raise InputError("read", "source", source, "a pattern that matches at least one file")
        paths += matching
    if not paths:
        raise InputError("read", "source", "none", "at least one path")
    return paths


def _manifests(
    sources: Sequence[Named], root: Path | None, given: Mapping[str, Any], *, massless: bool = False
) -> list[Manifest]:
    """Return the manifests of data, or drafts of them, with the given fields."""
    try:
        manifests = [_described(path, root, given, massless=massless) for path in _paths(sources)]
    except OSError as error:  # of a folder that may not be looked into
        reason = error.strerror or str(error)
        raise InputError(error.filename, "path", reason, "a readable file or folder") from None
    return [manifest.piece(given.get("from"), given.get("to")) for manifest in manifests]


def _described(
    path: Path, root: Path | None, given: Mapping[str, Any], *, massless: bool
) -> Manifest:
    suffix, neighbour = path.suffix.lower(), path.parent / MANIFEST_NAME
    if path.is_dir():
        if (path / MANIFEST_NAME).exists():
            return read_manifest(path / MANIFEST_NAME, root, given)
        _refuse_sweep(path)
        return draft(path, given, massless=massless)
    if names_result(path):
        return _saved_manifest(path, root, given)
    if suffix in FORMATS:
        listed = _entry_of(path, neighbour, root, given) if neighbour.exists() else None
        return listed or draft(path, given)
    if suffix not in _YAML:
        refuse_binary(path)
        expected = f"{ENDINGS}, a manifest (.yaml), or a saved result ({RESULT_ENDING})"
        raise InputError(path, "file name", path.suffix or "no ending", expected)
    try:
        return read_manifest(path, root, given)
    except InputError:
        keys = load_yaml(path).content.keys()
        if "logs" in keys or not keys & _OF_EXPERIMENTS:
            raise
        expected = f"logs; `butterfly run {path.name}` makes some in results/"
        raise InputError(path, "data", "an experiment", expected) from None


def _entry_of(
    path: Path, neighbour: Path, root: Path | None, given: Mapping[str, Any]
) -> Manifest | None:
    """Return the manifest reduced to one of its files; None if it does not list that file."""
    manifest = read_manifest(neighbour, root, given)
    folder, wanted = Path(manifest.root), path.resolve()
    entries = [entry for entry in manifest.logs if (folder / entry.file).resolve() == wanted]
    part = {"logs": entries, "name": given.get("name", path.name)}
    held = {"holdout": given.get("holdout", [])}  # what was asked for is used
    return manifest.model_copy(update=part | held) if entries else None


def _refuse_sweep(folder: Path) -> None:
    if is_sweep(folder):
        logs = sorted(path.parent for path in folder.glob(f"runs/*/*/{MANIFEST_NAME}"))
        which = f"one run's logs, such as {logs[0]}" if logs else "results with keep_signals: true"
        raise InputError(folder, "data", "the results of a sweep", which)


def _saved_manifest(path: Path, root: Path | None, given: Mapping[str, Any]) -> Manifest:
    """Return the manifest in a saved identification."""
    expected = "a saved identification"
    try:
        text = path.read_text(encoding="utf-8")
        document = json.loads(text)
        record = document["data"]["manifest"]
        place = record and record["root"]
        manifest = record and described({**record, "root": place or "."}, given, source=path)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        raise InputError(path, "data.manifest", "missing or damaged", expected) from None
    require_as_signed(path, text, document, "an undamaged saved result")
    if manifest is None:
        expected = "a result identified from files of one manifest, to read its logs again"
        raise InputError(path, "data.manifest", "missing", expected)
    if place is None and root is None:
        expected = "--root FOLDER, where the logs are"
        raise InputError(path, "data.manifest.root", "missing", expected)
    folder = root_of(path, manifest.root, root)
    if not folder.is_dir():
        expected = "an existing folder of logs; if they moved, --root FOLDER"
        raise InputError(path, "data.manifest.root", folder, expected)
    return manifest.model_copy(update={"root": str(folder)})


def root_of(path: Path, place: str, root: Path | None = None) -> Path:
    """Return a saved result's folder of logs; ``root`` if they were moved."""
    return (path.parent / place).resolve() if root is None else root.absolute()


def names_result(source: object) -> TypeGuard[Named]:
    """Whether something is the path of a saved result: JSON that is not a log."""
    if not isinstance(source, str | PathLike) or Path(source).suffix.lower() != RESULT_ENDING:
        return False
    try:
        with Path(source).open("rb") as file:
            return _OF_LOGS.match(file.read(_BEGINNING)) is None
    except OSError:
        return True


def is_run(path: Path) -> bool:
    """Whether a path names a run of a sweep: RESULTS/NUMBER, or RESULTS/KEY."""
    return is_sweep(path.parent) and not path.suffix and not path.exists()


def is_sweep(path: Path) -> bool:
    """Whether a path is a folder of a run's or a sweep's results."""
    return (path / SWEEP).exists()


def results_below(folder: Path) -> list[Path]:
    """Return the results in a folder: folders of runs and sweeps, and saved files."""
    folders = (file.parent for file in folder.glob(f"*/{SWEEP}"))
    files = (file for file in folder.glob(f"*{RESULT_ENDING}") if _begins_as_result(file))
    return sorted([*folders, *files])


def _begins_as_result(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return _OF_RESULT in file.read(_BEGINNING)
    except OSError:
        return False


def holds_logs(folder: Path, results: Sequence[Path]) -> bool:
    """Whether there are logs in a folder besides those of its ``results``."""
    paths = (path for path in log_files(folder) if not {path, *path.parents} & {*results})
    return (folder / MANIFEST_NAME).exists() or any(
        path.suffix.lower() not in OFTEN_OTHERS or holds_table(path) for path in paths
    )


def is_data(path: Path) -> bool:
    """Whether a path holds logs or a saved result; a file that is not YAML is not data."""
    if path.is_dir() or path.suffix.lower() in FORMATS or names_result(path):
        return True
    try:
        return "logs" in load_yaml(path).content
    except InputError:
        return False
