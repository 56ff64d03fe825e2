"""Load saved results."""

from __future__ import annotations

import json
import math
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any

from butterfly.api.sources import root_of
from butterfly.errors import InputError
from butterfly.files import read_file, whole
from butterfly.progress import budget
from butterfly.result import Result, schema_number

_MODULES = {
    "api.changed": "Changed",
    "api.compared": "Compared Leaderboard",
    "api.experiments": "Run Sweep",
    "api.identification": "Identification",
    "api.predicted": "Drawn Predicted",
    "api.results": "Designed Residual Selection Validated",
    "report.inspection": "Inspection",
    "report.parameter_table": "Separated",
}
"""Results that can be saved, by their module, which is imported when one is loaded."""


def _kinds() -> dict[str, Any]:
    """Return the classes of saved results by their schema."""
    pairs = [(import_module(f"butterfly.{m}"), names.split()) for m, names in _MODULES.items()]
    classes = [getattr(module, name) for module, names in pairs for name in names]
    return {f"butterfly.{each.kind}": each for each in classes}


def load(path: str | PathLike[str], *, root: str | PathLike[str] | None = None) -> Result:
    """Load a saved result.

    Parameters
    ----------
    path
        The saved file.
    root
        Folder of the logs, if they were moved without the result.

    Raises
    ------
    InputError
        If the file is damaged, from a newer butterfly, or not a saved result.
    """
    file = Path(path)
    content = _content(file)
    schema, kinds = content.get("schema"), _kinds()
    if not isinstance(schema, str) or schema not in kinds:
        expected = "a saved result (--save, or its method save; the JSON of a report is not one)"
        raise InputError(file, "schema", schema, expected)
    kind = kinds[schema]
    number, own = content.get("schema_number"), schema_number(kind.kind)
    if number != own:
        newer = isinstance(number, int) and number > own
        remedy = "update butterfly" if newer else "identify and save again with this butterfly"
        raise InputError(file, "schema_number", number, f"{own}: {remedy}")
    try:
        manifest = content.get("data", {}).get("manifest")
        moved = None if root is None else Path(root)
        if manifest is not None and (moved or manifest["root"]) is not None:
            manifest["root"] = str(root_of(file, manifest["root"], moved))
        with budget(math.inf):  # whatever else is searched for now, nothing of it is left out here
            result: Result = kind.from_dict(content)
        result.shown_rows(), result.tables(), result.facts()
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        expected = "an undamaged saved result"
        raise InputError(file, "content", f"{type(error).__name__}: {error}", expected) from None
    return result


def _content(file: Path) -> dict[str, Any]:
    with whole(file, "a saved result"):
        content = json.loads(read_file(file, "a saved result"))
    if not isinstance(content, dict):
        raise InputError(file, "content", type(content).__name__, "a saved result")
    return content
