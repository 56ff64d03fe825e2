"""YAML 1.2 files, read safely and written the same for every reader.

Any mistake is one InputError with file, line and field; `refusal` words those of other files and of
options too. No tag builds an object, a date is text, and the expansion of a small file is bounded.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from ruamel.yaml import YAML
from ruamel.yaml.composer import ComposerError
from ruamel.yaml.constructor import ConstructorError, DuplicateKeyError, SafeConstructor
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.representer import SafeRepresenter

from butterfly.errors import InputError, nearest, shown
from butterfly.files import read_file, refuse_binary

_DEEPEST = 50  # nested mappings and lists: more would raise a RecursionError
_MOST = 300_000  # values, aliases expanded
_SHOWN = 60  # characters of a bad value in a message
_LARGEST = 2_000_000  # bytes: more takes too long to read
_UNKNOWN_KEY = {"extra_forbidden", "unexpected_keyword_argument"}

_LONGEST = 120  # characters of any value in a message

_ONE_LINE = 1_000_000  # characters: nothing is wrapped
# What needs no quotes, unless it reads as a value.
_WORDS = re.compile(r"[^\W\d]([\w ./-]*[\w./-])?")

_PLAINER = {
    "a valid dictionary": "a mapping",
    "a valid frozenset": "a list",
    "a valid list": "a list",
}

_NOWHERE = object()

_Model = TypeVar("_Model", bound=BaseModel)


class StrictModel(BaseModel):
    """Base of all YAML schemas: immutable, unknown keys refused, no infinities."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True
    )


class OneOf(StrictModel):
    """Several optional keys; exactly one of those without a default must be given."""

    @model_validator(mode="after")
    def _one_of_them(self) -> OneOf:
        fields = type(self).model_fields.items()
        names = [name for name, field in fields if field.default is None]
        if sum(getattr(self, name) is not None for name in names) != 1:
            raise ValueError("exactly one of the keys " + ", ".join(names))
        return self

    @property
    def chosen(self) -> Any:  # noqa: ANN401 - as different as the keys
        """The value of the one key that was given."""
        return next(value for _, value in self if value is not None)


def validate(
    documents: Sequence[Document],
    content: dict[str, Any],
    schema: type[_Model],
    source: object = "content",
) -> _Model:
    """Validate ``content``; an error names the document with its field, else ``source``."""
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        known: dict[str, Any] = {"content": content, "documents": documents, "schema": schema}
        raise refusal(error, source, **known) from None
    except ArithmeticError as error:
        problem = f"numbers out of range ({error.args[-1]})"
        raise InputError(
            place_of(documents, [], source), "content", problem, "usual numbers"
        ) from None


def refusal(
    error: ValidationError,
    source: object,
    *,
    whole: str = "",
    content: object = None,
    documents: Sequence[Document] = (),
    schema: type[object] | None = None,
) -> InputError:
    """Return what pydantic refuses first, an unknown key before all else; all keys that miss.

    Parameters
    ----------
    error
        What validating raised.
    source
        What is named where no document has the field.
    whole
        What all of the content should be, which is added to what the field should be.
    content
        The plain values that were validated: a field is named as it is in them.
    documents
        Files of the content, whose lines are named.
    schema
        Model whose keys are named in place of an unknown one.
    """
    slips = error.errors()
    unknown = [slip for slip in slips if slip["type"] in _UNKNOWN_KEY]
    first = (unknown or slips)[0]  # a slip in a key is also a missing key, which says less
    location, missing = [str(part) for part in first["loc"]], first["type"] == "missing"
    field, cause = _field(content, location, lacking=missing), first.get("ctx", {}).get("error")
    where, suffix = place_of(documents, location, source), f", in {whole}" if whole else ""
    if unknown:
        names = [] if schema is None else _fields_at(schema, location[:-1])
        expected = nearest(location[-1], names) if names else "no such key"
        return InputError(where, field, "an unknown key", expected + suffix)
    if missing:
        absent = [slip["loc"] for slip in slips if slip["type"] == "missing"]
        keys = [str(way[-1]) for way in absent if way[:-1] == first["loc"][:-1]]
        required = "this key is required" if len(keys) == 1 else "these keys are required"
        fields = ", ".join([field, *keys[1:]])
        return InputError(where, fields, "nothing", f"a value ({required}){suffix}")
    if isinstance(cause, InputError):
        named = cause.field
        if not location:  # of the whole file, by a rule that names the field
            where = place_of(documents, [named], source)
        elif field != "content":
            named = f"{field}.{named.removeprefix(field.rpartition('.')[2] + '.')}"
        return InputError(where, named, cause.value, cause.expected + suffix)
    message = first["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    value = repr(first["input"])
    if len(value) > _LONGEST:
        value = value[:_LONGEST] + " ..."
    return InputError(where, field, value, _PLAINER.get(message, message) + suffix)


def _field(content: Any, location: Sequence[str], *, lacking: bool) -> str:  # noqa: ANN401 - whatever a file may say
    """Return pydantic's location of an error without the kinds that unions add."""
    if content is None:
        return ".".join(location) or "content"
    keys = []
    for part in location:
        below = _value(content, part)
        if below is not _NOWHERE:
            content = below
            keys.append(part)
    if lacking:
        keys.append(location[-1])
    return ".".join(keys) or "content"


def _value(content: Any, part: str) -> Any:  # noqa: ANN401 - whatever a file may say
    """Return the value in plain ``content`` at one part of a location, or `_NOWHERE`."""
    if isinstance(content, dict):
        return next((value for key, value in content.items() if str(key) == part), _NOWHERE)
    if isinstance(content, list) and part.isdigit() and int(part) < len(content):
        return content[int(part)]
    return _NOWHERE


def place_of(
    documents: Sequence[Document], location: Sequence[str], origin: object = "content"
) -> str:
    """Return the file and the line of a location; ``origin`` without documents."""
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
            for model in schemas
            if issubclass(model, BaseModel) and part in model.model_fields
            for below in _nested_schemas(model.model_fields[part].annotation)
        ]
        kinds = [s for s in schemas if part == s.__name__ or part in _defaults(s).values()]
        schemas = nested or kinds or schemas  # a part may name a member of a union
    return list(dict.fromkeys(name for model in schemas for name in _defaults(model)))


def _defaults(schema: type[object]) -> dict[str, Any]:
    """Return the fields of a model or dataclass, and their defaults."""
    if issubclass(schema, BaseModel):
        return {field.alias or name: field.default for name, field in schema.model_fields.items()}
    return {field.name: field.default for field in fields(schema)} if is_dataclass(schema) else {}


def _nested_schemas(annotation: Any) -> list[type[object]]:  # noqa: ANN401 - any annotation may stand here
    """Find the models and dataclasses inside an annotation such as ``list[AddedMass]``."""
    if isinstance(annotation, type) and (
        issubclass(annotation, BaseModel) or is_dataclass(annotation)
    ):
        return [annotation]
    return [nested for argument in get_args(annotation) for nested in _nested_schemas(argument)]


@dataclass(frozen=True, kw_only=True)
class Document:
    """A YAML file, parsed."""

    path: Path
    content: dict[str, Any]
    root: Node  # with line numbers

    def line(self, location: Sequence[str]) -> int | None:
        """Return the line, from 1, of a value by its keys and list indices; None if not here."""
        node, line = self.root, None
        for part in location:  # parts that are not keys, such as members of a union, are skipped
            key, child = _child(node, part)
            if child is not None:
                node, line = child, (key or child).start_mark.line + 1
        return line


def load_yaml(path: Path) -> Document:
    """Parse a file; InputError if it is missing, not YAML, not a mapping, or repeats a key."""
    text = _text(path)
    try:
        content, root = _parsed(text)
    except DuplicateKeyError as error:
        where = f"{path}:{error.problem_mark.line + 1}"
        key = error.problem.split('"')[1]
        raise InputError(where, key, "the same key twice", "one value") from None
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}" if mark else "content"
        problem = getattr(error, "problem", None) or "unreadable text"
        if problem.startswith("maximum depth"):
            problem = f"mappings and lists nested more than {_DEEPEST} deep"
        raise InputError(path, where, problem, "valid YAML") from None
    except (ValueError, LookupError):  # the parser raises these on damaged bytes
        raise InputError(path, "content", "unreadable text", "valid YAML") from None
    if not isinstance(content, dict):
        raise InputError(path, "content", type(content).__name__, "a mapping of keys to values")
    return Document(path=path, content=content, root=root)


def _text(path: Path) -> str:
    """Return the text of a file, unless it is too large."""
    refuse_binary(path)
    try:
        return read_file(path, "an existing YAML file", most=_LARGEST).decode()
    except UnicodeDecodeError:
        raise InputError(path, "content", "bytes that are not text", "YAML in UTF-8") from None


def _child(node: Node, part: str) -> tuple[Node | None, Node | None]:
    """Return the key node, if there is one, and the value node of a part of a location."""
    if isinstance(node, MappingNode):
        for key, value in reversed(node.value):  # merged values precede their replacements
            if key.value == part:
                return key, value
    if isinstance(node, SequenceNode) and part.isdigit() and int(part) < len(node.value):
        return None, node.value[int(part)]
    return None, None


class _PlainValues(SafeConstructor):
    """Builds mappings, lists, texts, numbers, truth values and null, as YAML 1.2's core schema."""

    def construct_object(self, node: Node, deep: bool = False) -> Any:  # noqa: ANN401 - ruamel's
        """Name the place of a value that does not fit its tag, such as `-_` or `!!bool 3`."""
        try:
            return super().construct_object(node, deep)
        except (ValueError, LookupError, TypeError, ArithmeticError):
            kind = str(node.tag).rpartition(":")[2]
            problem = f"{shown(node.value, _SHOWN)}, not a valid {kind}"
            raise ConstructorError(problem=problem, problem_mark=node.start_mark) from None

    def check_mapping_key(
        self, node: Node, key_node: Node, mapping: dict[str, Any], key: object, value: object
    ) -> bool:
        """Refuse keys that are not text, and repeated keys."""
        if not isinstance(key, str):
            raise ConstructorError(
                problem="a key that is not text", problem_mark=key_node.start_mark
            )
        return bool(super().check_mapping_key(node, key_node, mapping, key, value))


_TAG = "tag:yaml.org,2002:"
_PlainValues.yaml_constructors = {
    **{
        _TAG + name: SafeConstructor.yaml_constructors[_TAG + name]
        for name in ("null", "bool", "int", "float", "str", "seq", "map")
    },
    **{_TAG + name: SafeConstructor.construct_yaml_str for name in ("timestamp", "merge", "value")},
    None: SafeConstructor.construct_undefined,
}


class _Extent(NamedTuple):
    """How many values a node holds, and how deep, with aliases expanded."""

    size: int
    depth: int


def _extent(node: Node, known: dict[int, _Extent | None]) -> _Extent:
    """Return the extent of a node; refuse one that contains itself, or too much."""
    if id(node) in known:
        return known[id(node)] or _refuse(node, "an alias that contains itself")
    known[id(node)] = None
    below = node.value if isinstance(node, MappingNode | SequenceNode) else []
    parts = [part for child in below for part in (child if isinstance(child, tuple) else (child,))]
    extents = [_extent(part, known) for part in parts]
    size = 1 + sum(extent.size for extent in extents)
    depth = 1 + max((extent.depth for extent in extents), default=0)
    if size > _MOST:
        _refuse(node, f"more than {_MOST:,} values, with aliases expanded")
    if depth > _DEEPEST + 1:
        _refuse(node, f"aliases nested more than {_DEEPEST} deep")
    whole = known[id(node)] = _Extent(size, depth)
    return whole


def _refuse(node: Node, problem: str) -> NoReturn:
    raise ComposerError(problem=problem, problem_mark=node.start_mark)


def _parsed(text: str) -> tuple[Any, Node]:
    """Return the values and the nodes of a text."""
    yaml = YAML(typ="safe", pure=True)  # pure: the C parser knows YAML 1.1 only
    yaml.Constructor = _PlainValues
    yaml.max_depth = _DEEPEST
    yaml.composer.warn_double_anchors = False  # an anchor may be set anew
    root = yaml.compose(text)
    if root is not None:
        _extent(root, {})
    return None if root is None else yaml.constructor.construct_document(root), root


def yaml_text(content: dict[str, Any], *, flow: bool = False) -> str:
    """Return plain values as YAML, in the order of their keys; mappings in braces if ``flow``."""
    writer = YAML(typ="safe", pure=True)
    writer.Representer = _PlainWriter
    writer.default_flow_style = flow
    writer.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # typed as None
    writer.width = _ONE_LINE
    text = io.StringIO()
    writer.dump(content, text)
    return text.getvalue()


class _PlainWriter(SafeRepresenter):
    """Writes numbers and texts in the same way for every reader.

    Readers of YAML 1.1 see numbers in 1.0e-05, not in 1e-05. Texts other than words are quoted:
    ruamel.yaml 0.19 would write the text ``: 1`` bare in braces.
    """

    def represent_str(self, data: str) -> ScalarNode:
        style = None if _WORDS.fullmatch(data) else '"'
        return self.represent_scalar("tag:yaml.org,2002:str", data, style=style)

    def represent_float(self, data: float) -> ScalarNode:
        node = super().represent_float(data)
        if "." not in node.value:
            node.value = node.value.replace("e", ".0e")
        return node


_PlainWriter.add_representer(str, _PlainWriter.represent_str)
_PlainWriter.add_representer(float, _PlainWriter.represent_float)
