"""Read YAML 1.2 into a pydantic model, turning every slip into one InputError with its line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError

from butterfly.errors import InputError, nearest
from butterfly.yaml_document import Document, load_yaml

_UNKNOWN_KEY = {"extra_forbidden", "unexpected_keyword_argument"}

_LONGEST = 120  # characters of a value that a message repeats

_PLAINER = {
    "a valid dictionary": "a mapping",
    "a valid frozenset": "a list",
    "a valid list": "a list",
}

_NOWHERE = object()

_Model = TypeVar("_Model", bound=BaseModel)


class StrictModel(BaseModel):
    """Base of all YAML schemas: immutable, unknown keys refused, no infinities."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def read_yaml(path: Path, schema: type[_Model]) -> _Model:
    """Load ``path`` safely and validate it against ``schema``.

    Raises
    ------
    InputError
        If the file is missing, is not YAML, or does not follow the schema; the message names the
        file with the line, the field (as ``logs.3.added_mass``), its value and what was expected.
    """
    document = load_yaml(path)
    return validate([document], document.content, schema)


def validate(
    documents: Sequence[Document],
    content: dict[str, Any],
    schema: type[_Model],
    source: object = "content",
) -> _Model:
    """Validate parsed YAML ``content``, put together from ``documents``, against ``schema``.

    The first document that has a field is blamed for it; ``source``, where there are none.

    Raises
    ------
    InputError
        On the first field that does not follow the schema.
    """
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        raise _translate(documents, content, schema, error, source) from None


def _translate(
    documents: Sequence[Document],
    content: dict[str, Any],
    schema: type[BaseModel],
    error: ValidationError,
    origin: object,
) -> InputError:
    unknown = [e for e in error.errors() if e["type"] in _UNKNOWN_KEY]
    first = (unknown or error.errors())[0]  # a slip in a key is also a missing key, which says less
    location = [str(part) for part in first["loc"]]
    field = _field(content, location, lacking=first["type"] == "missing")
    source = _source(documents, location, origin)
    if unknown:
        names = _fields_at(schema, location[:-1])
        return InputError(source, field, "an unknown key", nearest(location[-1], names))
    if first["type"] == "missing":
        return InputError(source, field, "nothing", "a value (this key is required)")
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        if not location:  # of the whole file, by a rule that names the field
            return InputError(_source(documents, [cause.field], origin), *_told(cause))
        if cause.field.startswith(f"{field}."):
            return InputError(source, *_told(cause))
        return InputError(source, f"{field}.{cause.field}", cause.value, cause.expected)
    message = first["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    message = _PLAINER.get(message, message)
    shown = repr(first["input"])
    if len(shown) > _LONGEST:
        shown = shown[:_LONGEST] + " ..."
    return InputError(source, field, shown, message)


def _told(error: InputError) -> tuple[str, object, str]:
    return error.field, error.value, error.expected


def _field(content: Any, location: Sequence[str], *, lacking: bool) -> str:  # noqa: ANN401 - whatever a file may say
    """Return the location of an error as the document has it: without the kinds that unions add.

    Those are the parts that lead nowhere in the document.

    Parameters
    ----------
    content
        The document.
    location
        As pydantic says it.
    lacking
        Whether the last part is a key that the document lacks.
    """
    shown = []
    for part in location:
        below = _value(content, part)
        if below is not _NOWHERE:
            content = below
            shown.append(part)
    if lacking:
        shown.append(location[-1])
    return ".".join(shown) or "content"


def _value(content: Any, part: str) -> Any:  # noqa: ANN401 - whatever a file may say
    """Return what stands in plain ``content`` at one part of a location, or `_NOWHERE`."""
    if isinstance(content, dict):
        return next((value for key, value in content.items() if str(key) == part), _NOWHERE)
    if isinstance(content, list) and part.isdigit() and int(part) < len(content):
        return content[int(part)]
    return _NOWHERE


def _source(documents: Sequence[Document], location: Sequence[str], origin: object) -> str:
    """Name the file, and the line in it, that says what stands at ``location``."""
    for document in documents:
        line = document.line(location)
        if line is not None:
            return f"{document.path}:{line}"
    return str(documents[0].path if documents else origin)


def _fields_at(schema: type[object], location: Sequence[str]) -> list[str]:
    """Names of the valid keys of the (nested) mapping at ``location``."""
    schemas = [schema]
    for part in location:
        nested = [
            below
            for each in schemas
            if issubclass(each, BaseModel) and part in each.model_fields
            for below in _nested_schemas(each.model_fields[part].annotation)
        ]
        schemas = nested or [each for each in schemas if _is_kind(each, part)] or schemas
    return list(dict.fromkeys(name for each in schemas for name in _defaults(each)))


def _is_kind(schema: type[object], part: str) -> bool:
    """Whether a part of a location names this member of a union, by class or by discriminator."""
    return part == schema.__name__ or part in _defaults(schema).values()


def _defaults(schema: type[object]) -> dict[str, Any]:
    """Return the fields of a model or dataclass, and their defaults."""
    if issubclass(schema, BaseModel):
        return {name: field.default for name, field in schema.model_fields.items()}
    return {field.name: field.default for field in fields(schema)} if is_dataclass(schema) else {}


def _nested_schemas(annotation: Any) -> list[type[object]]:  # noqa: ANN401 - any annotation may stand here
    """Find the models and dataclasses inside an annotation such as ``list[AddedMass]``."""
    if isinstance(annotation, type) and (
        issubclass(annotation, BaseModel) or is_dataclass(annotation)
    ):
        return [annotation]
    return [found for argument in get_args(annotation) for found in _nested_schemas(argument)]
