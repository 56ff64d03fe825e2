"""Whatever holds logs or an experiment, read."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

from butterfly.api.in_memory import Table, is_table, log_of_table
from butterfly.errors import InputError
from butterfly.experiment.data_source import named_data
from butterfly.experiment.schema import Experiment
from butterfly.experiment.source import read_experiment as experiment_in
from butterfly.files import locate
from butterfly.identification.data import DataSet
from butterfly.identification.identification import Identification
from butterfly.logs.column_map import ColumnMap
from butterfly.logs.health import DEFAULT_REPAIRS, Repair
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.logs.pieces import WHOLE, Cut
from butterfly.model.known import NOTHING, Knowledge, known_of
from butterfly.model.parameters import JointKind

_OWN: tuple[dict[str, Any], frozenset[Repair]] = ({}, frozenset())  # of logs that are read already

Named: TypeAlias = str | PathLike[str]
"""A path, or the name of something shipped."""

One: TypeAlias = DataSet | Identification | Log | Named | Table
"""Whatever holds logs by itself."""

_CHOICES = (("input_kind", InputKind), ("intersample", Intersample), ("joint", JointKind))

Data: TypeAlias = One | Sequence[One]
"""Whatever `read` takes."""


def read(
    source: Data,
    *,
    root: Named | None = None,
    arm: float | None = None,
    input_kind: str | None = None,
    intersample: str | None = None,
    columns: ColumnMap | None = None,
    units: Mapping[str, str | float] | None = None,
    repair: Collection[str] | None = None,
    known: Mapping[str, Any] | None = None,
    joint: str | None = None,
    gravity: float | None = None,
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
        saved result; the name of a shipped data set; a `Log`, a `DataSet` or an `Identification`; a
        pandas frame, a mapping of arrays, or an array with named columns or of the columns t, u,
        q[, dq]; or several of these, whose files are then not remembered.
    root
        Folder of the logs, if not the one that the manifest names.
    arm
        Pivot to added mass in m, where no manifest says it.
    input_kind, intersample
        What the input commands (``voltage``, if not given, or ``torque``), and how it is held
        (``zero_order_hold``, if not given, or ``first_order_hold``), where no manifest says so.
    columns, units
        What holds ``time``, ``input`` and ``angle``: columns or variables, by name or number; and
        their units, such as ``{"time": "ms", "angle": "deg"}`` (see `butterfly.logs.units`). Both
        go before what a manifest says.
    repair
        Repairs that may be made besides: ``backward``, ``non_finite``, ``unwrap``.
    known
        What is known of the robot besides what manifests say: parameters of the model (``p4``,
        ``p3``, ...), of motor and hand (``resistance``, ``hand_mass``, ...), each a number, or a
        pair of a value and its standard uncertainty.
    joint, gravity
        How the joint moves (``hinge`` or ``slide``), and the gravity in m/s^2 across its axis, if
        not as manifests say.
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
    begin, end = _ends(piece)
    cut = Cut(begin=begin, end=end, restarts=bool(restarts))
    about: dict[str, Any] = {
        "joint": joint,
        "gravity": gravity,
        "root": root,
        "arm": arm,
        "input_kind": input_kind,
        "intersample": intersample,
        "columns": columns,
        "units": units,
        "cut": None if cut == WHOLE else cut,
    }
    repairs = _repairs(repair)
    data = _read(source, about, repairs, name).knowing(Knowledge.told(known or {}, "read"))
    return data if zero is None else data.with_zero(known_of(zero, "read", "zero"))


def _read(source: Data, about: Mapping[str, Any], repairs: frozenset[Repair], name: str) -> DataSet:
    """Read a source, or several, about which something is told (see `read`)."""
    told = {key: value for key, value in about.items() if value is not None}
    if isinstance(source, DataSet | Identification | Log):
        if told:
            expected = "none beside logs that are read already"
            raise InputError("read", next(iter(told)), next(iter(told.values())), expected)
        return _repaired(source, repairs, name)
    if isinstance(source, Sequence) and not isinstance(source, str):
        return _together(source, name, about, repairs)
    return _read_one(source, told, repairs, name)


def _read_one(
    source: Named | Table, told: dict[str, Any], repairs: frozenset[Repair], name: str
) -> DataSet:
    """Read a path, a name or a table."""
    if "root" in told:
        told["root"] = Path(told["root"])
    for key, kind in _CHOICES:
        if key in told:
            told[key] = choice(kind, "read", key, told[key])
    if isinstance(source, str | PathLike):
        return named_data(_path("read", "source", source), repair=repairs, **told)
    if is_table(source):
        return _repaired(log_of_table(source, told), repairs, name)
    expected = "a path, a name, logs, a table, or several of these"
    raise InputError("read", "source", type(source).__name__, expected)


def _ends(piece: tuple[float | None, float | None] | None) -> tuple[float | None, float | None]:
    if piece is None:
        return None, None
    if not isinstance(piece, Sequence) or len(piece) != 2:  # noqa: PLR2004 - begin and end
        raise InputError("read", "piece", piece, "first and last instant in s, such as (1.5, None)")
    return piece[0], piece[1]


def _repairs(told: Collection[str] | None) -> frozenset[Repair]:
    if told is None:
        return frozenset()
    if isinstance(told, str) or not isinstance(told, Collection):
        raise InputError("read", "repair", repr(told), f"a list such as [{str(told)!r}]")
    return frozenset(choice(Repair, "read", "repair", each) for each in told)


def _repaired(
    source: DataSet | Identification | Log, repairs: frozenset[Repair], name: str
) -> DataSet:
    """Return the data set of what is read already, with more repairs."""
    if isinstance(source, Log):
        return DataSet.of([source], name=source.name or name, repairs=DEFAULT_REPAIRS | repairs)
    data = source if isinstance(source, DataSet) else source.data
    if repairs:
        raise InputError(
            "read", "repair", ", ".join(sorted(repairs)), "none of a repaired data set"
        )
    return data


def _together(
    sources: Sequence[Any], name: str, about: Mapping[str, Any], repairs: frozenset[Repair]
) -> DataSet:
    """Read several sources as one data set; every source's own repairs are made."""
    if len(sources) == 1 and not isinstance(sources[0], Log):
        return _read(sources[0], about, repairs, name)
    said = about, repairs
    parts = [
        each if isinstance(each, Log) else _read(each, *(_OWN if _is_read(each) else said), name)
        for each in sources
    ]
    logs: list[Log] = []
    held: list[Log] = []
    known = NOTHING
    repairs |= DEFAULT_REPAIRS
    for part in parts:
        if isinstance(part, Log):
            logs.append(part)
            continue
        known = known.agreeing(part.told, part.name)
        logs.extend(part.recorded)
        held.extend(() if part.held is None else part.held.recorded)
        if part.manifest is not None:
            repairs |= part.manifest.repair
    data = DataSet.of([*logs, *held], name=name, known=known, repairs=repairs)
    return data.holding(range(len(logs), len(data.logs)))


def _is_read(source: object) -> bool:
    return isinstance(source, DataSet | Identification)


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
