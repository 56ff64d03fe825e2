"""Joints for the tests of exported code, and the system's compiler for it."""

import ctypes
import shutil

import numpy as np
import pytest

from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind, LumpedParameters
from butterfly.twin.twin import Twin
from tests.programs import said

STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1")
TICK = 2.0**-14  # s

needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler is installed")
needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")

RUN = """#include "{0}.h"
void run_{0}(int n, const double *commands, double angle, double velocity, int which, double value,
         double *angles) {{
    {0}_parameters p = {0}_identified();
    {0}_state s;
    if (which >= 0) ((double *)&p)[which] = value;
    {0}_reset(&s, angle, velocity);
    for (int k = 0; k < n; k++) {{
        {0}_step(&s, &p, commands[k]);
        angles[k] = s.angle;
    }}
}}
"""

STRIBECK = {"coulomb": 0.02, "stribeck": 0.01, "stribeck_velocity": 0.2}
GEAR = {"coulomb": 0.01, "motor_friction": 0.1, "load_friction": 0.2}
BASE = {"base_compliance": 2e-5, "base_frequency": 40.0, "base_damping": 0.02}
KINDS = {
    "smooth": {},
    "coulomb": {"coulomb": 0.02},
    "stribeck": STRIBECK,
    "bristles": STRIBECK | {"bristle_stiffness": 20.0, "bristle_damping": 0.01},
    "lag": {"coulomb": 0.02, "back_emf": 0.01, "time_constant": 0.004},
    "lag and stribeck": STRIBECK | {"back_emf": 0.01, "time_constant": 0.004},
    "gear": GEAR,
    "gear at rest": GEAR
    | {"motor_stribeck": 0.1, "load_stribeck": 0.05}
    | {"lifting_stribeck": 0.02, "lowering_stribeck": 0.01},
    "friction by angle": {"coulomb": 0.02, "coulomb_slope": 0.01},
    "pulled": {"coulomb": 0.01, "drag": 0.001, "bias": 0.03, "spring": 0.2, "p3_offset": 0.05}
    | {"cogging": 0.02, "cogging_cosine": 0.01, "cogging_periods": 7.0},
    "base": BASE,
    "base and friction": STRIBECK | BASE,
    "drive": {"coulomb": 0.02, "dead_zone": 0.03, "compression": 0.1},
    "slide": {"coulomb": 0.02, "drag": 0.001},
}


def drawn(seed, kind):
    """A random joint of a kind, a step in s, and commands that begin and stop now and then.

    Instants are multiples of a tick: rounding of the time is no matter of a comparison.
    """
    rng = np.random.default_rng(seed)
    draw, step = rng.uniform, float(rng.integers(8, 80) * TICK)
    drive = {"limit": 0.4, "resolution": 0.01} if kind == "drive" else {}
    terms = {name: each * draw(0.5, 2) for name, each in KINDS[kind].items()}
    if "cogging" in terms:
        terms["cogging_periods"] = 7.0
    p1, p2 = 0.03 * draw(0.5, 2), 0.03 * draw(0.2, 2)
    p3, p4 = 0.0 if kind == "slide" else draw(0.5, 2), draw(0.5, 2)
    delay = float(rng.integers(1, 200) * TICK) if seed % 3 else 0.0
    parameters = LumpedParameters(p1=p1, p2=p2, p3=p3, p4=p4, delay=delay, **terms)
    joint = JointKind.SLIDE if kind == "slide" else JointKind.HINGE
    about = {"joint": joint, "kind": InputKind.TORQUE, "parameters": parameters}
    twin = Twin(name=f"{seed}. {kind}", **about, **drive)
    time = step * np.arange(int(4 / step))
    commands = 0.3 * np.sin(6 * time) + 0.2 * np.sin(9.7 * time + draw(0, 6))
    commands[time < 0.1] = 0
    commands[(time > 1) & (time < 1.7)] = 0
    commands[time > 3] = 0.02
    return twin, step, commands


def libraries(headers, folder):
    """Compile headers by their names; return what moves each by (n,) commands: (n + 1,) angles.

    It can change one parameter, by its number.
    """
    for name, header in headers.items():
        (folder / f"{name}.h").write_text(header, encoding="ascii")
    source, unlinked, made = (folder / each for each in ("run.c", "run.o", "run.so"))
    source.write_text("".join(map(RUN.format, headers)))
    compile_with("cc", "-std=c99", "-fPIC", "-c", source, "-o", unlinked)
    said("cc", "-shared", unlinked, "-o", made, "-lm")
    loaded = ctypes.CDLL(str(made))
    return {name: _mover(getattr(loaded, f"run_{name}")) for name in headers}


def library(header, name, folder):
    """Compile one header; return what moves it."""
    return libraries({name: header}, folder)[name]


def _mover(run):
    array = np.ctypeslib.ndpointer(np.float64, flags="C")
    whole, number = ctypes.c_int, ctypes.c_double
    run.argtypes = [whole, array, number, number, whole, number, array]

    def move(commands, angle, velocity, which=-1, value=0.0):
        angles = np.empty(commands.size)
        run(commands.size, commands, angle, velocity, which, value, angles)
        return np.append(angle, angles)

    return move


def compile_with(compiler, *arguments):
    """Compile, without a warning."""
    said(compiler, *STRICT, *arguments)
