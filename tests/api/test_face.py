"""`import butterfly as bf` shows what there is, and loads it when it is used."""

import ast
import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import butterfly as bf

PACKAGE = Path(bf.__file__).parent
ROOMS = sorted(
    path.parent.relative_to(PACKAGE.parent).as_posix().replace("/", ".")
    for path in PACKAGE.rglob("__init__.pyi")
)


def _python(code):
    return subprocess.run(  # noqa: S603 - our own code
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()


def test_nothing_heavy_is_loaded_before_it_is_used():
    heavy = {"numpy", "scipy", "mujoco", "numba", "pydantic", "plotly", "matplotlib", "control"}
    code = f"import butterfly as bf, sys; dir(bf); print(*({heavy!r} & sys.modules.keys()))"
    assert _python(code) == []


@pytest.mark.parametrize("room", ROOMS)
def test_every_name_that_a_stub_promises_is_there(room):
    module = importlib.import_module(room)
    tree = ast.parse((Path(module.__file__).with_suffix(".pyi")).read_text())
    names = {
        alias.asname
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert names
    assert names <= set(dir(module))
    for name in names:
        assert getattr(module, name) is not None


@pytest.mark.parametrize("verb", ["identify", "compare"])
def test_a_verb_that_bears_a_package_s_name_is_both(verb):
    code = (
        f"import butterfly as bf; before = callable(bf.{verb}); import butterfly.{verb} as room; "
        f"import butterfly.identify.data as data; print(before, callable(bf.{verb}), "
        f"room is bf.{verb}, data.DataSet is bf.DataSet)"
    )
    assert _python(code) == ["True"] * 4


def test_the_signature_of_a_verb_is_its_own():
    for verb in ("identify", "compare", "read"):
        assert next(iter(inspect.signature(getattr(bf, verb)).parameters)) in {"data", "source"}


def test_a_name_that_is_none_is_an_attribute_error():
    with pytest.raises(AttributeError, match="identfy"):
        bf.identfy  # noqa: B018


def test_no_two_files_bear_one_name_unless_one_shows_the_other():
    rooms = {}
    for path in PACKAGE.rglob("*.py"):
        if path.stem not in {"__init__", "__main__"} and path.parent.name != "report":
            rooms.setdefault(path.stem, []).append(path.parent.name)
    assert {name: places for name, places in rooms.items() if len(places) > 1} == {}
