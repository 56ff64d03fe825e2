"""Load saved results."""

from __future__ import annotations

import json
import math
from os import PathLike
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from butterfly.api.identification import Identification
from butterfly.api.predicted import Drawn, Predicted
from butterfly.api.sources import root_of
from butterfly.arguments import checked
from butterfly.errors import InputError
from butterfly.files import read_file, require_as_signed, whole
from butterfly.progress import budget
from butterfly.result import ANSWERS, Answer

_WITH_MORE: dict[str, type[Answer]] = {
    "draws": Drawn,
    "identification": Identification,
    "prediction": Predicted,
}
"""Answers that can do more than others."""


@checked
def load(path: str | PathLike[str], *, root: str | PathLike[str] | None = None) -> Answer:
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
    kind = schema.removeprefix("butterfly.") if isinstance(schema, str) else ""
    if kind not in ANSWERS:
        expected = "a saved result (--save, or its method save; the JSON of a report is not one)"
        raise InputError(file, "schema", schema, expected)
    number, current = content.get("schema_number"), ANSWERS[kind]
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
            answer = answer_of(content)
            answer.tables(), answer.facts(), answer.printed()
    except ValidationError as error:
        first, expected = error.errors()[0], "an undamaged saved result"
        given, place = first["input"], ".".join(map(str, first["loc"])) or "content"
        number = given if isinstance(given, str | int | float | None) else type(given).__name__
        raise InputError(file, place, number, f"{expected} ({first['msg']})") from None
    except (LookupError, TypeError, ValueError, AttributeError, StopIteration) as error:
        expected = "an undamaged saved result"
        raise InputError(file, "content", f"{type(error).__name__}: {error}", expected) from None
    return answer


def answer_of(content: dict[str, Any], **more: Any) -> Answer:  # noqa: ANN401 - other fields
    """Return the answer of a document; ``more``: fields of `Answer` that are not saved.

    Raises as `Answer.from_dict` and `Estimate.from_dict` do.
    """
    of_logs = (entry for entry in content.get("estimates", ()) if "fits" in entry)
    if identified := {entry["estimator"]: Identification.from_dict(entry) for entry in of_logs}:
        more["identifications"] = identified
    kind = content["schema"].removeprefix("butterfly.")
    return _WITH_MORE.get(kind, Answer).from_dict(content, **more)


def kind_of(file: Path) -> str:
    """Return the kind of answer that a file seems to hold; empty if none."""
    try:
        schema = json.loads(file.read_bytes())["schema"]
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return ""
    kind = str(schema).removeprefix("butterfly.")
    return kind if kind in ANSWERS else ""


def read_saved(file: Path) -> dict[str, Any]:
    """Return the content of a saved result; InputError if it is none, or damaged."""
    with whole(file, "a saved result"):
        text = read_file(file, "a saved result").decode()
        content = json.loads(text)
    if not isinstance(content, dict):
        raise InputError(file, "content", type(content).__name__, "a saved result")
    require_as_signed(file, text, content, "an undamaged saved result")
    return content
