"""Whatever holds logs or an experiment, read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from butterfly.api.identified import Identified
from butterfly.errors import InputError
from butterfly.experiment.data_source import named_data
from butterfly.experiment.reading import read_experiment as experiment_in
from butterfly.identify.data import DataSet
from butterfly.logs.health import DEFAULT_REPAIRS
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.logs.pieces import WHOLE, Cut
from butterfly.model.known import Knowledge, known_of
from butterfly.resources import locate

if TYPE_CHECKING:
    from butterfly.experiment.schema import Experiment

Named: TypeAlias = str | PathLike[str]
"""A path, or the name of something shipped."""

Data: TypeAlias = DataSet | Identified | Log | Named | Sequence[DataSet | Identified | Log | Named]
"""Whatever `read` takes."""


def read(
    source: Data,
    *,
    root: Named | None = None,
    arm: float | None = None,
    input_kind: str | None = None,
    intersample: str | None = None,
    columns: Mapping[str, str] | None = None,
    known: Mapping[str, Any] | None = None,
    zero: Any = None,  # noqa: ANN401 - a number, with or without an uncertainty
    piece: tuple[float | None, float | None] | None = None,
    restarts: bool | None = None,
    name: str = "logs",
) -> DataSet:
    """Read logs, check them, repair what may be repaired, and fit the steady response of sines.

    Parameters
    ----------
    source
        A manifest; a folder with one, or with logs named like Data_52__8__002.mat; a log file; a
        saved result; the name of a shipped data set; a `Log`, a `DataSet` or an `Identified`; or
        several of these, whose files are then not remembered.
    root
        Folder of the logs, if not the one that the manifest names.
    arm
        Pivot to added mass in m, where no manifest says it.
    input_kind, intersample, columns
        What the input commands (``voltage``, if not given, or ``torque``), how it is held
        (``zero_order_hold``, if not given, or ``first_order_hold``), and the columns of a .csv file
        (``time``, ``input``, ``angle``), where no manifest says so.
    known
        What is known of the robot besides what manifests say: parameters of the model (``p4``,
        ``p3``, ...), of motor and hand (``resistance``, ``hand_mass``, ...), each a number, or a
        pair of a value and its standard uncertainty.
    zero
        What the encoder reads in rad where the hand hangs, in place of what manifests and logs
        tell: a number, or a pair of a value and its standard uncertainty.
    piece
        First and last instant in s, by its own clock, of what is meant of a single log; None for
        its ends.
    restarts
        Whether a file whose clock falls back holds several recordings, each a log.
    name
        Of the data set, where several logs are put together.

    Raises
    ------
    InputError
        Naming file, field, value and what was expected.
    """
    begin, end = piece or (None, None)
    cut = Cut(begin=begin, end=end, restarts=bool(restarts))
    about: dict[str, Any] = {
        "root": root,
        "arm": arm,
        "input_kind": input_kind,
        "intersample": intersample,
        "columns": columns,
        "cut": None if cut == WHOLE else cut,
    }
    data = _read(source, about, name).knowing(Knowledge.told(known or {}, "read"))
    return data if zero is None else data.with_zero(known_of(zero, "read", "zero"))


def _read(source: Data, about: Mapping[str, Any], name: str) -> DataSet:
    """Read a source, or several, about which something is told (see `read`)."""
    told = {key: value for key, value in about.items() if value is not None}
    if isinstance(source, DataSet | Identified | Log):
        if told:
            expected = "none beside logs that are read already"
            raise InputError("read", next(iter(told)), next(iter(told.values())), expected)
        if isinstance(source, Log):
            return DataSet.of([source], name=source.name or name)
        return source if isinstance(source, DataSet) else source.data
    if "root" in told:
        told["root"] = Path(told["root"])
    for key, kind in (("input_kind", InputKind), ("intersample", Intersample)):
        if key in told:
            told[key] = choice(kind, "read", key, told[key])
    if isinstance(source, str | PathLike):
        return named_data(_path("read", "source", source), **told)
    if not isinstance(source, Sequence):
        expected = "a path, a name, logs, or several of these"
        raise InputError("read", "source", type(source).__name__, expected)
    if len(source) == 1 and not isinstance(source[0], Log):
        return _read(source[0], about, name)
    return _together(source, name, about)


def _together(sources: Sequence[Any], name: str, about: Mapping[str, Any]) -> DataSet:
    """Read several sources as one data set; every source's own repairs are made."""
    parts = [
        each if isinstance(each, Log) else _read(each, {} if _is_read(each) else about, name)
        for each in sources
    ]
    logs: list[Log] = []
    held: list[Log] = []
    repairs = DEFAULT_REPAIRS
    for part in parts:
        if isinstance(part, Log):
            logs.append(part)
            continue
        logs.extend(part.recorded)
        held.extend(() if part.held is None else part.held.recorded)
        if part.manifest is not None:
            repairs |= part.manifest.repair
    data = DataSet.of([*logs, *held], name=name, repairs=repairs)
    return data.holding(range(len(logs), len(data.logs)))


def _is_read(source: object) -> bool:
    return isinstance(source, DataSet | Identified)


def read_experiment(path: Named) -> Experiment:
    """Read an experiment file, or a shipped one by its name.

    Raises
    ------
    InputError
        On the first field that does not follow the schema, with file and line.
    """
    return experiment_in(locate(_path("read_experiment", "path", path)))


def choice(kind: Any, verb: str, field: str, value: object) -> Any:  # noqa: ANN401 - any enumeration of texts
    """Return a member of an enumeration of texts, which a verb was told in a field.

    Raises
    ------
    InputError
        If it has no such member.
    """
    try:
        return kind(value)
    except ValueError:
        raise InputError(verb, field, value, " or ".join(map(str, kind))) from None


def _path(verb: str, field: str, given: Named) -> Path:
    if not str(given):
        raise InputError(verb, field, "an empty text", "a path or a name")
    return Path(given)
