"""What the options of a command write, checked before anything is done."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from cyclopts import Parameter

from butterfly import outputs
from butterfly.errors import InputError

_STDOUT = Path("-")


@dataclass(frozen=True)
class OutputFile:
    """What an option writes: a file with one of these endings; without any, a folder."""

    endings: tuple[str, ...] = ()
    companion: str = ""  # ending of another file that is written with it
    documents: tuple[str, ...] = ()  # marks of JSON, if it holds any
    copies: str = ""  # argument whose file, if given, is copied: the copy holds no mark


SAVED = OutputFile((".json",), documents=(outputs.mark_of_document("identification", "saved"),))
REPORT = OutputFile((".html",), companion=".json", documents=('"schema": "butterfly.',))
FOLDER = OutputFile()


def options_of(command: object) -> dict[tuple[str, ...], tuple[str, OutputFile]]:
    """Return name and files of each option that writes, by the path of its argument."""
    options: dict[tuple[str, ...], tuple[str, OutputFile]] = {}
    for name, hint in get_type_hints(command, include_extras=True).items():
        kind, *metadata = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        if is_dataclass(kind):
            options.update({(name, *way): entry for way, entry in options_of(kind).items()})
        names = [
            parameter.name
            for parameter in metadata
            if isinstance(parameter, Parameter) and parameter.name
        ]
        option = next(iter(names[0])) if names else f"--{name}"
        for annotation in metadata:
            if isinstance(annotation, OutputFile):
                options[name,] = option, annotation
    return options


def check(
    command: object, arguments: Mapping[str, Any], json: Path | None, kinds: Sequence[str]
) -> None:
    """Note a command's inputs and refuse forbidden outputs; ``kinds``: documents of ``json``."""
    writing = options_of(command)
    files = {}
    if json is not None and json != _STDOUT:
        marks = tuple(map(outputs.mark_of_document, kinds))
        files["--json"] = json, OutputFile((".json",), documents=marks)
    for way, value in _values(arguments):
        if way in writing:
            option, written = writing[way]
            files[option] = Path(value), written
        else:
            outputs.note_input(Path(value))
    named = {option: path for option, (path, written) in files.items() if written.endings}
    for option, (path, written) in files.items():
        _require_kind(path, written, option)
        if written.companion:
            named[f"the numbers beside {option}"] = path.with_suffix(written.companion)
    taken: dict[Path, str] = {}
    for option, path in named.items():
        if taken.setdefault(path.resolve(), option) != option:
            other = taken[path.resolve()]
            raise InputError(path, option, f"the file of {other}", "another name for one of them")
        written = files[option.rpartition(" ")[2]][1]
        if path.suffix:
            is_json = path.suffix.lower() == ".json"
            marks = written.documents if is_json else (outputs.mark_of(path),)
            marks = () if arguments.get(written.copies) is not None else marks
            outputs.require_free(path, *marks, option=option)


def _require_kind(path: Path, written: OutputFile, option: str) -> None:
    """Raise InputError for another ending, a file instead of a folder, or a folder instead."""
    folder = not written.endings or ("" in written.endings and not path.suffix)
    if path.exists() and path.is_dir() != folder:
        raise InputError(path, option, *(("a file", "a folder")[:: 1 if folder else -1]))
    if written.endings:
        outputs.require_endings(path, written.endings, option)


def _values(values: object, way: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield each path or text among the values of arguments, after its path of names."""
    if isinstance(values, Path | str):
        yield way, values
    elif isinstance(values, Mapping):
        for name, value in values.items():
            yield from _values(value, (*way, name))
    elif isinstance(values, tuple):
        for value in values:
            yield from _values(value, way)
    elif is_dataclass(values):
        yield from _values(
            {field.name: getattr(values, field.name) for field in fields(values)}, way
        )
