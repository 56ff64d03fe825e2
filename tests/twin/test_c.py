"""The C header moves as the compiled kernel from which it is translated."""

import os
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import butterfly
from butterfly.model.parameters import AddedMass
from butterfly.model.servo import ServoLoop
from butterfly.plant.motor import CommandPath
from butterfly.twin import c
from butterfly.twin.forms import Options, write_as
from butterfly.twin.twin import Yardstick
from tests.programs import said
from tests.twin.compiled import KINDS, compile_with, drawn, libraries, library, needs_cc

EXACT = 1e-12  # rad
STICKING = {"coulomb", "stribeck", "gear", "lag", "base and friction", "drive", "slide"}


def _delivered(twin, commands):
    shaped = CommandPath(limit=twin.limit, resolution=twin.resolution).shape_all(commands)
    return np.asarray(twin.parameters.delivered(shaped))


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """What moves a joint of each kind by its header, and where all were compiled at once."""
    folder, headers = tmp_path_factory.mktemp("headers"), {}
    for seed, kind in enumerate(KINDS):
        twin, step, _ = drawn(seed, kind)
        headers[twin.identifier] = c.header(twin, step, 1 + seed % 2, ())
    return libraries(headers, folder), folder


@needs_cc
def test_headers_need_sine_and_exponential_alone_of_libm_and_are_cpp_too(compiled):
    _, folder = compiled
    wanted = {*said("nm", "-u", folder / "run.o").split()} - {"U", "_GLOBAL_OFFSET_TABLE_"}
    assert wanted <= {"sin", "exp"}
    if shutil.which("c++"):
        compile_with("c++", "-x", "c++", "-fsyntax-only", folder / "run.c")


@needs_cc
@pytest.mark.parametrize(("seed", "kind"), [*enumerate(KINDS)])
def test_the_header_moves_as_the_compiled_kernel(kind, seed, compiled):
    twin, step, commands = drawn(seed, kind)
    substeps, move = 1 + seed % 2, compiled[0][twin.identifier]
    delivered, start = _delivered(twin, commands), (0.0, 0.0)
    ours, _ = c.held_motion(twin.loaded, np.zeros(64), delivered, start, step, substeps)
    assert np.ptp(ours) > 0.1
    assert np.abs(move(commands, 0.0, 0.0) - ours).max() < EXACT
    assert kind not in STICKING or ours[int(0.09 / step)] == 0 != ours[-1]


@needs_cc
def test_a_parameter_that_is_varied_moves_it_as_in_the_kernel(tmp_path):
    twin, step, commands = drawn(1, "stribeck")
    header = c.header(twin, step, 1, ())
    named = re.findall(r"double (\w+); /\*", header.split("_parameters;")[0])
    move, p = library(header, twin.identifier, tmp_path), twin.parameters
    varied = {"coulomb": 0.0, "stribeck": 0.0, "p1": 0.7 * p.p1, "delay": 0.0}
    for name, value in (*varied.items(), ("delay", 1.6 * p.delay)):
        other = replace(twin, parameters=replace(p, **{name: value}))
        ours, _ = c.held_motion(other.loaded, np.zeros(64), commands, (0.2, 0.5), step)
        moved = move(commands, 0.2, 0.5, named.index(name), value)
        assert np.abs(moved - ours).max() < EXACT


@needs_cc
@pytest.mark.parametrize("kind", ["stribeck", "bristles", "slide"])
def test_it_moves_as_our_simulation_within_the_error_that_it_prints(kind, tmp_path):
    twin, step, _ = drawn(2, kind)
    made = write_as("c", twin, Options(timestep=step))
    move = library(made.text, twin.identifier, tmp_path)
    (case,) = Yardstick.of(twin, step).cases
    error = np.abs(move(case.commands, case.angle, case.velocity) - case.simulated).max()
    assert error < made.accuracy.worst + EXACT
    assert error < 1e-4
    assert f"{made.accuracy.worst:.2g}" in made.text.split("*/")[0]


def test_what_it_cannot_hold_is_said_in_the_file_too():
    twin, step, _ = drawn(1, "smooth")
    servo = ServoLoop.of({"law": "dynamixel-xl330", "kp": 400, "supply": 7.4})
    parameters = replace(twin.parameters, delay=-1e-3, slow_delay=2e-3, slow_interval=0.1)
    made = write_as("c", replace(twin, servo=servo, parameters=parameters), Options(timestep=step))
    first = " ".join(made.text.split("*/")[0].split())
    assert len(made.left_out) == 3
    assert all(sentence in first for sentence in made.left_out)


def test_the_header_of_a_plain_joint_has_what_it_needs_and_no_more():
    twin, step, _ = drawn(0, "smooth")
    named = replace(twin, name="*/ one /* day", added=AddedMass(mass=0.1, arm=0.1))
    header = c.header(named, step, 1, ())
    assert header.startswith("/* * / one / * day: moves")
    named = re.findall(r"double (\w+); /\*", header.split("_parameters;")[0])
    assert named == ["p4", "p1", "viscous", "p3"]
    assert repr(twin.parameters.p1 + 1e-3) in header
    assert len(header.splitlines()) < 200
    assert max(map(len, header.splitlines())) <= 110


TERM = {
    "model/terms.py": (
        "    spring: float = 0.0\n",
        "    spring: float = 0.0\n    cubic: float = 0.0\n",
        '    Term("p3_offset",',
        '    Term("cubic", "c", "N m/rad³", "stiffness that grows", basis=lambda m: m.angle**3),\n'
        '    Term("p3_offset",',
    ),
    "model/kernel/equation.py": (
        "    coulomb_slope: float\n",
        "    coulomb_slope: float\n    cubic: float\n",
        "- c.spring * x\n",
        "- c.spring * x - c.cubic * x * x * x\n",
    ),
}
EXPORT = """
import sys
from pathlib import Path
import numpy as np
from butterfly.model.parameters import LumpedParameters
from butterfly.twin import c
from butterfly.twin.twin import Twin
twin = Twin(parameters=LumpedParameters(p1=0.03, p2=0.02, p3=1.0, p4=1.0, coulomb=0.02, cubic=4.0))
Path("joint.h").write_text(c.header(twin, 2.0**-9, 1, ()), encoding="ascii")
commands = 0.5 * np.sin(np.arange(128) / 20)
moved, _ = c.held_motion(twin.loaded, np.zeros(64), commands, (0.5, 0.0), 2.0**-9)
np.save("moved.npy", [commands, moved[1:]])
"""


@needs_cc
def test_a_term_that_is_added_to_the_kernel_is_in_c_as_well(tmp_path):
    package = tmp_path / "butterfly"
    hidden = shutil.ignore_patterns("*.nb[ci]")
    shutil.copytree(Path(butterfly.__file__).parent, package, ignore=hidden)
    for name, (*changes,) in TERM.items():
        text = (package / name).read_text(encoding="utf-8")
        for former, present in zip(changes[::2], changes[1::2], strict=True):
            assert text.count(former) == 1
            text = text.replace(former, present)
        (package / name).write_text(text, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(tmp_path), "NUMBA_DISABLE_JIT": "1"}
    said(sys.executable, "-c", EXPORT, cwd=tmp_path, env=environment)
    commands, ours = np.load(tmp_path / "moved.npy")
    header = (tmp_path / "joint.h").read_text(encoding="ascii")
    assert "double cubic; /* N m/rad^3: stiffness that grows */" in header
    moved = library(header, "joint", tmp_path)(np.ascontiguousarray(commands), 0.5, 0.0)
    assert np.abs(moved[1:] - ours).max() < EXACT
