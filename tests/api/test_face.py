"""`import butterfly as bf` shows what there is, and loads it when it is used."""

import ast
import inspect
import pickle
import sys
from pathlib import Path

import pytest

import butterfly as bf
from tests.programs import said

PACKAGE = Path(bf.__file__).parent


def test_nothing_heavy_is_loaded_before_it_is_used():
    heavy = {"numpy", "scipy", "mujoco", "numba", "pydantic", "plotly", "matplotlib", "control"}
    code = f"import butterfly as bf, sys; dir(bf); print(*({heavy!r} & sys.modules.keys()))"
    assert said(sys.executable, "-c", code).split() == []


def test_every_name_that_the_stub_promises_is_there():
    tree = ast.parse((PACKAGE / "__init__.pyi").read_text())
    names = {
        alias.asname
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert names
    assert names <= set(dir(bf))
    for name in names:
        assert getattr(bf, name) is not None


def test_a_verb_is_a_plain_function_that_can_be_sent_to_another_process():
    for verb in ("identify", "compare", "read"):
        function = getattr(bf, verb)
        assert pickle.loads(pickle.dumps(function)) is function  # noqa: S301 - our own
        assert function.__doc__ != bf.__doc__
        assert next(iter(inspect.signature(function).parameters)) in {"data", "source"}


def test_a_name_that_is_none_is_an_attribute_error():
    with pytest.raises(AttributeError, match="identfy"):
        bf.identfy  # noqa: B018


def test_no_two_files_bear_one_name_unless_one_shows_the_other():
    rooms = {}
    for path in PACKAGE.rglob("*.py"):
        if path.stem not in {"__init__", "__main__"} and path.parent.name not in {"cli", "report"}:
            rooms.setdefault(path.stem, []).append(path.parent.name)
    assert {name: places for name, places in rooms.items() if len(places) > 1} == {}
