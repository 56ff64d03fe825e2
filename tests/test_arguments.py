"""Whatever a public function is given, it answers or names the argument."""

import inspect
import math
from pathlib import Path

import numpy as np
import pytest

import butterfly as bf
from butterfly.arguments import checked
from butterfly.errors import ButterflyError, InputError

NONSENSE = [5, -1, 1.5, math.nan, 10**30, b"x", None, True, "", "x", "\0", "x" * 5000]
NONSENSE += [object(), [], {}, (), ["a", 5], [None], [[1]], {"a": 1}, np.zeros(3), len]
FIRST = {
    **dict.fromkeys(("read", "identify", "inspect", "compare", "residual", "validate"), ()),
    **dict.fromkeys(("select", "design", "load", "run", "simulate", "campaign"), ()),
    "read_experiment": (),
    "predict": ("nowhere.json",),
    "draws": (),
    "changed": ("nowhere.json",),
}


@pytest.fixture(scope="module")
def saved_data(quick_data, tmp_path_factory):
    """A saved identification by the fastest method."""
    path = tmp_path_factory.mktemp("saved") / "saved.json"
    bf.identify(quick_data, "weak-form", terms=()).save(path)
    return path


@pytest.mark.parametrize("verb", FIRST)
def test_what_is_no_data_is_refused(verb, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for each in NONSENSE:
        with pytest.raises(ButterflyError):
            getattr(bf, verb)(each, *FIRST[verb])


def test_of_every_verb_nonsense_in_an_argument_is_named(saved_data, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    calls = {"identify", "validate", "residual", "compare", "design", "inspect", "predict", "read"}
    for verb in calls:
        function = getattr(bf, verb)
        kinds = {n: str(p.annotation) for n, p in inspect.signature(function).parameters.items()}
        given = [saved_data, saved_data][: 1 + (verb == "predict")]
        for name in [*kinds][len(given) :]:
            if kinds[name] in {"Track", "int", "bool", "Sequence[str]", "Named | None"}:
                with pytest.raises(InputError, match=f"^{verb}: {name}: got .*; expected "):
                    function(*given, **{name: object()})


@pytest.mark.parametrize("path", [5, b"x", None, 1.5, [], "\0"])
def test_what_is_no_path_is_refused_by_what_writes(path, saved_data):
    found = bf.load(saved_data)
    for write in (found.report, found.save):
        with pytest.raises(InputError, match=f"^{write.__name__}: path: got .*expected a path"):
            write(path)


def test_numbers_of_numpy_are_numbers_and_paths_are_paths():
    def taking(n, x, where, names, b):
        return n, x, where, names, b

    kinds = "int", "float | str", "Named", "Sequence[str]", "bool | None"
    taking.__annotations__ = dict(zip(("n", "x", "where", "names", "b"), kinds, strict=True))
    taking = checked(taking)
    given = (np.int64(3), np.float32(0.5), Path("a"), ("b",), np.bool(True))
    assert taking(*given) == given
    assert taking(*given[:-1], None)[-1] is None
    for wrong in (True, 3.0, "3", 2**64):
        with pytest.raises(InputError, match=r"^taking: n: got .*; expected a whole number"):
            taking(wrong, *given[1:])


def test_of_a_campaign_nonsense_is_named_before_anything_moves(tmp_path):
    for name in ("arm", "angle", "speed", "current", "seconds", "change", "callbacks", "goal"):
        with pytest.raises(InputError, match=rf"{name}: got "):
            bf.campaign("quickstart", out=tmp_path / "c", **{name: object()})
    assert not (tmp_path / "c").exists()
