"""Read YAML into a pydantic model, turning every slip into one InputError with its line."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from butterfly.errors import InputError, nearest

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_UNKNOWN_KEY = {"extra_forbidden", "unexpected_keyword_argument"}

_LONGEST = 120  # characters of a value that a message repeats

_Model = TypeVar("_Model", bound=BaseModel)


class StrictModel(BaseModel):
    """Base of all YAML schemas: immutable, unknown keys refused, no infinities."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


@dataclass(frozen=True, kw_only=True)
class Document:
    """A YAML file, parsed.

    Parameters
    ----------
    path
        The file.
    content
        Its mapping.
    root
        Its nodes, which know their lines.
    """

    path: Path
    content: dict[str, Any]
    root: yaml.Node

    def line(self, location: Sequence[str]) -> int | None:
        """Return the line, from 1 on, of a value by its keys and list indices; None if not here.

        Parts that are no keys (the kinds of a union, say) are skipped.
        """
        node, found = self.root, None
        for part in location:
            key, child = _child(node, part)
            if child is not None:
                node, found = child, (key or child).start_mark.line + 1
        return found


def load_yaml(path: Path) -> Document:
    """Parse a YAML file safely.

    Raises
    ------
    InputError
        If the file is missing, is not YAML, is no mapping, or says a key twice.
    """
    try:
        text = path.read_text(encoding="utf-8")
        content, root = yaml.safe_load(text), yaml.compose(text, yaml.SafeLoader)
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
    if not isinstance(content, dict) or root is None:
        raise InputError(path, "content", type(content).__name__, "a mapping of keys to values")
    _refuse_repeated_keys(path, root)
    return Document(path=path, content=content, root=root)


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
    documents: Sequence[Document], content: dict[str, Any], schema: type[_Model]
) -> _Model:
    """Validate parsed YAML ``content``, put together from ``documents``, against ``schema``.

    Parameters
    ----------
    documents
        Where the content stood; the first that has a field is blamed for it.
    content
        To be validated.
    schema
        The model.

    Raises
    ------
    InputError
        On the first field that does not follow the schema.
    """
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        raise _translate(documents, schema, error) from None


def _translate(
    documents: Sequence[Document], schema: type[BaseModel], error: ValidationError
) -> InputError:
    unknown = [e for e in error.errors() if e["type"] in _UNKNOWN_KEY]
    first = (unknown or error.errors())[0]  # a slip in a key is also a missing key, which says less
    location = [str(part) for part in first["loc"]]
    field = ".".join(location) or "content"
    source = _source(documents, location)
    if unknown:
        names = _fields_at(schema, location[:-1])
        return InputError(source, field, "an unknown key", nearest(location[-1], names))
    if first["type"] == "missing":
        return InputError(source, field, "nothing", "a value (this key is required)")
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        return InputError(source, f"{field}.{cause.field}", cause.value, cause.expected)
    message = first["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    shown = repr(first["input"])
    if len(shown) > _LONGEST:
        shown = shown[:_LONGEST] + " ..."
    return InputError(source, field, shown, message)


def _source(documents: Sequence[Document], location: Sequence[str]) -> str:
    """Name the file, and the line in it, that says what stands at ``location``."""
    for document in documents:
        line = document.line(location)
        if line is not None:
            return f"{document.path}:{line}"
    return str(documents[0].path)


def _child(node: yaml.Node, part: str) -> tuple[yaml.Node | None, yaml.Node | None]:
    """Return the key node, if there is one, and the value node of a part of a location."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            if key.value == part:
                return key, value
    if isinstance(node, yaml.SequenceNode) and part.isdigit() and int(part) < len(node.value):
        return None, node.value[int(part)]
    return None, None


def _refuse_repeated_keys(path: Path, root: yaml.Node) -> None:
    """Raise InputError if a mapping says a key twice, of which the parser would drop one."""
    pending = [root]
    while pending:
        node = pending.pop()
        if isinstance(node, yaml.MappingNode):
            seen = set()
            for key, value in node.value:
                if key.value in seen and key.tag != "tag:yaml.org,2002:merge":
                    where = f"{path}:{key.start_mark.line + 1}"
                    raise InputError(where, str(key.value), "the same key twice", "one value")
                seen.add(key.value)
                pending.append(value)
        elif isinstance(node, yaml.SequenceNode):
            pending.extend(node.value)


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
