"""Read YAML into a pydantic model, turning every slip into one InputError."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from butterfly.errors import InputError, nearest

if TYPE_CHECKING:
    from pathlib import Path

_UNKNOWN_KEY = {"extra_forbidden", "unexpected_keyword_argument"}

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
        field (as ``logs.3.added_mass``), its value and what was expected.
    """
    return validate(path, _load(path), schema)


def validate(source: object, content: object, schema: type[_Model]) -> _Model:
    """Validate parsed YAML ``content`` (from ``source``) against ``schema``.

    Raises
    ------
    InputError
        On the first field that does not follow the schema.
    """
    if not isinstance(content, dict):
        raise InputError(source, "content", type(content).__name__, "a mapping of keys to values")
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        raise _translate(source, schema, error) from None


def _load(path: Path) -> object:
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(path, "path", "no such file", "an existing YAML file") from None
    except IsADirectoryError:
        raise InputError(path, "path", "a folder", "a YAML file") from None
    except UnicodeDecodeError:
        raise InputError(path, "content", "bytes that are not text", "YAML in UTF-8") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}" if mark else "content"
        problem = getattr(error, "problem", None) or "unreadable text"
        raise InputError(path, where, problem, "valid YAML") from None


def _translate(source: object, schema: type[BaseModel], error: ValidationError) -> InputError:
    unknown = [e for e in error.errors() if e["type"] in _UNKNOWN_KEY]
    first = (unknown or error.errors())[0]  # a slip in a key is also a missing key, which says less
    location = [str(part) for part in first["loc"]]
    field = ".".join(location) or "content"
    if unknown:
        names = _fields_at(schema, location[:-1])
        return InputError(source, field, "an unknown key", nearest(location[-1], names))
    if first["type"] == "missing":
        return InputError(source, field, "nothing", "a value (this key is required)")
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        return InputError(source, f"{field}.{cause.field}", cause.value, cause.expected)
    message = first["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    return InputError(source, field, repr(first["input"]), message)


def _fields_at(schema: type[object], location: list[str]) -> list[str]:
    """Names of the valid keys of the (nested) mapping at ``location``."""
    for part in location:
        model_fields = schema.model_fields if issubclass(schema, BaseModel) else {}
        if part in model_fields:
            schema = _nested_schema(model_fields[part].annotation) or schema
    if is_dataclass(schema):
        return [field.name for field in fields(schema)]
    return list(schema.model_fields) if issubclass(schema, BaseModel) else []


def _nested_schema(annotation: Any) -> type[object] | None:  # noqa: ANN401 - any annotation may stand here
    """Find the model or dataclass inside an annotation such as ``list[AddedMass]``."""
    if isinstance(annotation, type) and (
        issubclass(annotation, BaseModel) or is_dataclass(annotation)
    ):
        return annotation
    nested = (_nested_schema(argument) for argument in get_args(annotation))
    return next((schema for schema in nested if schema is not None), None)
