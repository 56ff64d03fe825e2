"""YAML 1.2 files as plain values, and where in the file each stands.

No tag builds an object, a date is a text, and what a small file may unfold to is bounded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from ruamel.yaml import YAML
from ruamel.yaml.composer import ComposerError
from ruamel.yaml.constructor import ConstructorError, DuplicateKeyError, SafeConstructor
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, Node, SequenceNode

from butterfly.errors import InputError, shown
from butterfly.sizes import said

_DEEPEST = 50  # mappings and lists within each other: more would end in a RecursionError
_MOST = 300_000  # values, what aliases stand for counted each time
_SHOWN = 60  # characters of a value that a message repeats
_LARGEST = 2_000_000  # bytes: more takes longer to read than anybody waits


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
    root: Node

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
    """Parse a YAML file into plain values: no tag builds an object, and a date is a text.

    Raises
    ------
    InputError
        If the file is missing, is not YAML, is no mapping, or says a key twice.
    """
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
            problem = f"mappings and lists more than {_DEEPEST} deep"
        raise InputError(path, where, problem, "valid YAML") from None
    except (ValueError, LookupError):  # what the parser meets damaged bytes with
        raise InputError(path, "content", "unreadable text", "valid YAML") from None
    if not isinstance(content, dict):
        raise InputError(path, "content", type(content).__name__, "a mapping of keys to values")
    return Document(path=path, content=content, root=root)


def _text(path: Path) -> str:
    """Return what a file says, if it is one that anybody would wait for."""
    try:
        size = path.stat().st_size
        if size > _LARGEST:
            raise InputError(path, "content", said(size), f"a YAML file of up to {said(_LARGEST)}")
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(path, "path", "no such file", "an existing YAML file") from None
    except IsADirectoryError:
        raise InputError(path, "path", "a folder", "a YAML file") from None
    except UnicodeDecodeError:
        raise InputError(path, "content", "bytes that are not text", "YAML in UTF-8") from None
    except OSError as error:
        raise InputError(path, "path", error.strerror, "a readable YAML file") from None


def _child(node: Node, part: str) -> tuple[Node | None, Node | None]:
    """Return the key node, if there is one, and the value node of a part of a location."""
    if isinstance(node, MappingNode):
        for key, value in reversed(node.value):  # what is merged in stands before what replaces it
            if key.value == part:
                return key, value
    if isinstance(node, SequenceNode) and part.isdigit() and int(part) < len(node.value):
        return None, node.value[int(part)]
    return None, None


class _PlainValues(SafeConstructor):
    """Builds mappings, lists, texts, numbers, truth values and null, as YAML 1.2's core schema."""

    def construct_object(self, node: Node, deep: bool = False) -> Any:  # noqa: ANN401 - ruamel's
        """Tell where a value stands that is unlike its tag, such as `-_` or `!!bool 3`."""
        try:
            return super().construct_object(node, deep)
        except (ValueError, LookupError, TypeError, ArithmeticError):
            kind = str(node.tag).rpartition(":")[2]
            problem = f"{shown(node.value, _SHOWN)}, which is no {kind}"
            raise ConstructorError(problem=problem, problem_mark=node.start_mark) from None

    def check_mapping_key(
        self, node: Node, key_node: Node, mapping: dict[str, Any], key: object, value: object
    ) -> bool:
        """Refuse keys that are no texts, besides those that recur."""
        if not isinstance(key, str):
            raise ConstructorError(
                problem="a key that is no text", problem_mark=key_node.start_mark
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
    """How many values a node holds, and how deep, what aliases stand for counted each time."""

    size: int
    depth: int


def _extent(node: Node, known: dict[int, _Extent | None]) -> _Extent:
    """Return the extent of a node.

    Parameters
    ----------
    node
        To be looked at.
    known
        What was found, by the identity of nodes; None of those that hold this one.

    Raises
    ------
    YAMLError
        If it holds itself, or too much.
    """
    if id(node) in known:
        return known[id(node)] or _refuse(node, "an alias within what it stands for")
    known[id(node)] = None
    below = node.value if isinstance(node, MappingNode | SequenceNode) else []
    parts = [part for each in below for part in (each if isinstance(each, tuple) else (each,))]
    extents = [_extent(part, known) for part in parts]
    size = 1 + sum(each.size for each in extents)
    depth = 1 + max((each.depth for each in extents), default=0)
    if size > _MOST:
        _refuse(node, f"more than {_MOST:,} values, what aliases stand for counted each time")
    if depth > _DEEPEST + 1:
        _refuse(node, f"aliases more than {_DEEPEST} deep")
    found = known[id(node)] = _Extent(size, depth)
    return found


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
