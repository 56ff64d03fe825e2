"""Functions of the kernel in C and JavaScript return what they return here."""

import ast
import ctypes
import importlib
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.model.kernel.steps import exceeds_at
from butterfly.twin.languages import C, JavaScript
from butterfly.twin.translate import NUMBER, Translator
from tests.programs import said
from tests.twin.compiled import compile_with, needs_cc, needs_node

NUMBERS = st.floats(-1e6, 1e6)


def _helped(x):
    return math.ceil(x), round(x), math.sqrt(abs(x)), math.cos(x), np.sign(x), max(x, 1.0, -x)


@pytest.fixture(scope="module")
def in_c(tmp_path_factory):
    """`_helped` and `exceeds_at` by the system's compiler."""
    folder = tmp_path_factory.mktemp("helped")
    helped = Translator({}).function(_helped, NUMBER)
    leaving = Translator({}).function(exceeds_at, (NUMBER,) * 3, NUMBER, NUMBER, NUMBER)
    text = C("a", [helped, leaving]).text()
    source, made = folder / "helped.c", folder / "helped.so"
    run = (
        "void run(double x, double *y) { const a_6 made = a_helped(x); y[0] = made.e0; "
        "y[1] = made.e1; y[2] = made.e2; y[3] = made.e3; y[4] = made.e4; y[5] = made.e5; }\n"
        "void leave(const double *x, double *y) { const a_2 made = a_exceeds_at("
        "a_3_of(x[0], x[1], x[2]), x[3], x[4], x[5]); y[0] = made.e0; y[1] = made.e1; }\n"
    )
    heads = "void run(double x, double *y);\nvoid leave(const double *x, double *y);\n"
    source.write_text(f"#include <math.h>\n{text}\n{heads}{run}")
    compile_with("cc", "-std=c99", "-shared", "-fPIC", source, "-o", made, "-lm")
    return ctypes.CDLL(str(made))


@needs_cc
@given(x=NUMBERS | st.integers(-50, 50).map(lambda k: k / 2))
def test_what_c_does_without_libm_is_what_python_does(in_c, x):
    made = (ctypes.c_double * 6)()
    in_c.run(ctypes.c_double(x), made)
    whole, near, root, cosine, sign, most = made
    ours = _helped(x)
    assert (whole, near, sign, most) == (ours[0], ours[1], ours[4], ours[5])
    assert root == pytest.approx(ours[2], rel=3e-16)
    assert cosine == pytest.approx(ours[3], abs=4e-16)


@needs_cc
@given(drives=st.tuples(*[st.floats(-2, 2)] * 3), begin=st.floats(0, 1), width=st.floats(0.01, 3))
def test_a_loop_over_signs_with_early_ends_is_the_same_in_c(in_c, drives, begin, width):
    made = (ctypes.c_double * 2)()
    in_c.leave((ctypes.c_double * 6)(*drives, begin, -width, width), made)
    at, side = exceeds_at.py_func(drives, begin, -width, width)
    assert made[0] == pytest.approx(at, abs=1e-9)
    assert made[1] == side or at > 1 - 1e-9


def _written(rng, depth):
    """A random expression of x and y, as Python spells it without needless brackets."""
    if not depth:
        return rng.choice(["x", "y", "0.0", "1.0", "-2.5", "ON"])
    one, two, three = (_written(rng, depth - 1) for _ in range(3))
    forms = (
        *(f"({one}) {op} ({two})" for op in "+-*+-*"),
        f"({one}) / (2.0 + abs({two}))",
        f"-({one})",
        f"(({one}) - ({two})) ** 2",
        *(f"{name}({one}, {two}, {three})" for name in ("min", "max")),
        f"({one}) if ({two}) < ({three}) else ({two})",
        f"({one}) if ON > 0 and not ({two}) <= ({three}) < 2.0 or ({one}) > 0.5 else ({two})",
    )
    return ast.unparse(ast.parse(rng.choice(forms)))


@needs_node
def test_random_expressions_are_the_same_in_javascript(tmp_path, monkeypatch):
    rng = np.random.default_rng(31)
    lines = ["ON = 1.0"]
    for k in range(25):
        values = [_written(rng, depth) for depth in (1, 3, 4)]
        lines += [
            f"def f{k}(x, y):",
            f"    z = {values[0]}",
            f"    if {values[0]} > {values[1]}:",
            f"        z += {values[1]}",
            "    for _ in range(2):",
            f"        x, y = y, {values[2]}",
            "    return z, x - y, y",
        ]
    (tmp_path / "random_functions.py").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(tmp_path)
    module = importlib.import_module("random_functions")
    functions = [getattr(module, f"f{k}") for k in range(25)]
    made = [Translator({}).function(each, NUMBER, NUMBER) for each in functions]
    text = JavaScript("a", made).text()
    numbers = {"x": "1.25", "y": "-0.75"}
    calls = [
        f"a_f{k}({', '.join(numbers[name] for name in each.arguments)})"
        for k, each in enumerate(made)
    ]
    script = tmp_path / "random.js"
    script.write_text(f"{text}\nconsole.log(JSON.stringify([{', '.join(calls)}]))")
    theirs = json.loads(said("node", script))
    ours = [each(1.25, -0.75) for each in functions]
    assert np.ptp(ours) > 1
    np.testing.assert_allclose(theirs, ours, rtol=1e-12, atol=1e-12)
