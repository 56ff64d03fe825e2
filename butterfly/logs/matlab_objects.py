"""MATLAB's tables, timetables and timeseries, as structs, by the package mat-io."""

from __future__ import annotations

import re
import warnings
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from butterfly.errors import InputError

_SIGNAL = "t = {x}Time; u = squeeze({x}Data); save('log.mat', 't', 'u')"
_CONVERSIONS = {
    "table": "writetable(x, 'log.csv')",
    "timetable": "T = timetable2table(x); T.(1) = seconds(T.(1)); writetable(T, 'log.csv')",
    "Simulink.SimulationData.Dataset": _SIGNAL.format(x="x{1}.Values."),
    "Simulink.SimulationOutput": _SIGNAL.format(x="x.logsout{1}.Values."),
    "Simulink.SimulationData.Signal": _SIGNAL.format(x="x.Values."),
}  # lines of MATLAB that convert an object x; all others are converted as timeseries
_EXTRA = "needs the extra matlab (pip install 'butterfly-testbed[matlab]')"


@dataclass(frozen=True)
class MatlabObject:
    """An object that was not read."""

    kind: str = ""

    def refused(self, path: Path, wanted: str, name: str = "x") -> InputError:
        """Return the error, with a line of MATLAB that converts the object."""
        line = re.sub(r"\bx\b", name, _CONVERSIONS.get(self.kind, _SIGNAL.format(x="x.")))
        kind = f" ({self.kind})" if self.kind else ""
        why = "mat-io does not read" if find_spec("matio") else _EXTRA
        value = f"a MATLAB object{kind}, which {why}"
        return InputError(path, wanted, value, f"plain vectors or a table; in MATLAB: {line}")


def is_skipped(value: Any) -> bool:  # noqa: ANN401 - whatever a file holds
    """Whether anything but objects of known classes was left out; such data may be damaged."""
    unread = [leaf for leaf in _leaves(value) if isinstance(leaf, str | MatlabObject)]
    return not all(isinstance(leaf, MatlabObject) and leaf.kind for leaf in unread)


def _leaves(value: Any) -> list[Any]:  # noqa: ANN401 - whatever a file holds
    below = [*value.values()] if isinstance(value, dict) else value
    return (
        [leaf for part in below for leaf in _leaves(part)] if isinstance(below, list) else [value]
    )


def opened(path: Path, variables: Mapping[str, Any], wanted: Collection[str]) -> dict[str, Any]:
    """Return the wanted variables that hold objects, with these as structs, unless it fails."""
    # only of whole parts, which mat-io takes for granted
    known = [name for name in wanted if name in variables and not is_skipped(variables[name])]
    leaves = {name: _leaves(variables[name]) for name in known}
    names = [n for n in known if any(isinstance(leaf, MatlabObject) for leaf in leaves[n])]
    with warnings.catch_warnings(), suppress(Exception):  # an object that is not read is refused
        warnings.simplefilter("ignore")
        if names:
            from matio import load_from_mat  # noqa: PLC0415 - an extra

            objects = load_from_mat(str(path), variable_names=[*names], add_table_attrs=True)
            return {name: _filled(variables[name], objects[name]) for name in names}
    return {}


def _filled(before: Any, after: Any) -> Any:  # noqa: ANN401 - whatever a file holds
    """Return what was read, its objects as mat-io reads them."""
    if isinstance(before, dict):
        (one,) = np.ravel(after)
        return {name: _filled(part, one[name]) for name, part in before.items()}
    if isinstance(before, list):
        return [_filled(*pair) for pair in zip(before, np.ravel(after, "F"), strict=True)]
    value = _plain(after) if isinstance(before, MatlabObject) else before
    is_clock = isinstance(value, np.ndarray) and value.dtype.kind in "mM"
    return value if is_clock or not isinstance(value, np.ndarray) else before


def _plain(value: Any) -> Any:  # noqa: ANN401 - whatever a file holds
    """Return an object as a struct, if it is of a known kind."""
    if hasattr(value, "attrs"):
        return _frame(value)
    if not isinstance(getattr(value, "properties", None), dict):
        return value
    properties = {name.rstrip("_"): _plain(part) for name, part in value.properties.items()}
    known = (
        _series(properties) if value.classname == "timeseries" else MatlabObject(value.classname)
    )
    return properties if value.classname.startswith("tsdata.") else known


def _series(properties: dict[str, Any]) -> dict[str, Any]:
    """Return the columns of a timeseries, whose times may be a start and an increment."""
    about = properties["TimeInfo"]
    time = np.ravel(properties.get("Time", about.get("Time", ())))
    if not time.size:
        start, step, count = (np.ravel(about[key])[0] for key in ("Start", "Increment", "Length"))
        time = start + step * np.arange(min(int(count), np.size(properties["Data"])))
    units = {"Time": about.get("Units"), "Data": properties.get("DataInfo", {}).get("Units")}
    return {"Time": time, "Data": np.squeeze(properties["Data"]), "Properties": {"units": units}}


def _frame(frame: Any) -> dict[str, Any]:  # noqa: ANN401 - pandas'
    """Return the columns of a table, or of a timetable with its row times first."""
    units, texts = (
        frame.attrs.get(f"Variable{key}") or frame.attrs.get(f"var{key}") or [""] * frame.shape[1]
        for key in ("Units", "Descriptions")
    )
    headings = [
        {"name": name, "unit": "" if column.dtype.kind in "mM" else unit, "description": text}
        for (name, column), unit, text in zip(frame.items(), units, texts, strict=True)
    ]
    frame = frame if frame.index.name is None else frame.reset_index()
    columns = {str(name): column.to_numpy() for name, column in frame.items()}
    return columns | {"Properties": {"columns": headings}}
