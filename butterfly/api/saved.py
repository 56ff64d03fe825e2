"""Load saved results."""

from __future__ import annotations

import json
import math
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any

from butterfly.api.sources import root_of
from butterfly.arguments import checked
from butterfly.errors import InputError
from butterfly.files import read_file, require_as_signed, whole
from butterfly.progress import budget
from butterfly.result import Result, schema_number

_KINDS = {
    "butterfly.campaign": ("api.campaigns", "Campaign"),
    "butterfly.change": ("api.changed", "Changed"),
    "butterfly.comparison": ("api.compared", "Compared"),
    "butterfly.leaderboard": ("api.compared", "Leaderboard"),
    "butterfly.run": ("api.experiments", "Run"),
    "butterfly.sweep": ("api.experiments", "Sweep"),
    "butterfly.model": ("api.inspected", "RobotModel"),
    "butterfly.identification": ("api.identification", "Identification"),
    "butterfly.draws": ("api.predicted", "Drawn"),
    "butterfly.prediction": ("api.predicted", "Predicted"),
    "butterfly.design": ("api.results", "Designed"),
    "butterfly.residual": ("api.results", "Residual"),
    "butterfly.selection": ("api.results", "Selection"),
    "butterfly.validation": ("api.results", "Validated"),
    "butterfly.inspection": ("api.inspected", "Inspection"),
    "butterfly.physical": ("api.results", "Separated"),
}
"""Module and class of results that can be saved, by schema; one is imported when it is loaded."""


@checked
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
    content = read_saved(file)
    schema = content.get("schema")
    if not isinstance(schema, str) or schema not in _KINDS:
        expected = "a saved result (--save, or its method save; the JSON of a report is not one)"
        raise InputError(file, "schema", schema, expected)
    module, name = _KINDS[schema]
    kind: Any = getattr(import_module(f"butterfly.{module}"), name)
    number, current = content.get("schema_number"), schema_number(kind.kind)
    if number != current:
        newer = isinstance(number, int) and number > current
        remedy = "update butterfly" if newer else "identify and save again with this butterfly"
        raise InputError(file, "schema_number", number, f"{current}: {remedy}")
    try:
        manifest = content.get("data", {}).get("manifest")
        moved = None if root is None else Path(root)
        if manifest is not None and (moved or manifest["root"]) is not None:
            manifest["root"] = str(root_of(file, manifest["root"], moved))
        with budget(math.inf):  # loading is complete, even while a search has a time limit
            result: Result = kind.from_dict(content)
        columns = {tuple(row) for row in result.shown_rows()}
        if len(columns) > 1 or content.get("rows") == []:
            raise ValueError("rows with different columns" if columns else "no rows")
        result.tables(), result.facts()
    except (LookupError, TypeError, ValueError, AttributeError, StopIteration) as error:
        expected = "an undamaged saved result"
        raise InputError(file, "content", f"{type(error).__name__}: {error}", expected) from None
    return result


def read_saved(file: Path) -> dict[str, Any]:
    """Return the content of a saved result; InputError if it is none, or damaged."""
    with whole(file, "a saved result"):
        text = read_file(file, "a saved result").decode()
        content = json.loads(text)
    if not isinstance(content, dict):
        raise InputError(file, "content", type(content).__name__, "a saved result")
    require_as_signed(file, text, content, "an undamaged saved result")
    return content
