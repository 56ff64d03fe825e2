"""Exported compensation cancels what kernel and MuJoCo have, within the error that it states."""

import ctypes
import json
import math
import shutil
from dataclasses import fields, replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

import butterfly as bf
from butterfly.errors import InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FreeRun
from butterfly.logs.log import InputKind, Log, Sine
from butterfly.model.greybox import constants_of
from butterfly.model.kernel.equation import friction_level, pull, rates
from butterfly.model.parameters import AddedMass, JointKind, LumpedParameters
from butterfly.plant.rig import Rig
from butterfly.plant.robot import Robot
from butterfly.plant.sensors import Clock, Encoder
from butterfly.twin.compensation import Compensation, limited, steady_torque, unlimited
from butterfly.twin.forms import Options, write_as
from butterfly.twin.twin import Twin
from butterfly.verdict import SPREADS
from tests.plant.setting import simulated
from tests.programs import said
from tests.twin.compiled import KINDS, compile_with, drawn, needs_cc
from tests.twin.moving import acceleration

PYTHON = Options(ending=".py")
ADDED = AddedMass(mass=0.1, arm=0.1)
RUN = """#include "{0}.h"
double command_{0}(double x, double v, double way) {{
    const {0}_parameters p = {0}_identified();
    return {0}_command(&p, x, v, way);
}}
double error_{0}(double x, double v, double way) {{
    const {0}_parameters p = {0}_identified();
    return {0}_error(&p, x, v, way);
}}
"""


def _estimated(twin, seed=0, size=0.05):
    """The same joint as an estimate whose errors are some per cent and correlated."""
    known = {each.name: each.default for each in fields(LumpedParameters)}
    kept = {"cogging_periods", "bristle_damping", "delay", "p1", "stribeck_velocity"}
    values = {k: each for k, each in vars(twin.parameters).items() if each != known[k]}
    names = (*sorted(values.keys() - kept), "p1")
    drawn = np.random.default_rng(seed).standard_normal((2 * len(names), len(names)))
    means = np.array([values[name] for name in names])
    covariance = size**2 * np.outer(means, means) * (drawn.T @ drawn) / len(drawn)
    half = SPREADS * np.sqrt(np.diag(covariance))
    estimate = Estimate(
        method="drawn",
        names=names,
        values=means,
        covariance=covariance,
        lower=means - half,
        upper=means + half,
        fixed={name: each for name, each in values.items() if name not in names},
    )
    return replace(twin, estimate=estimate)


def _points(seed, count=40):
    draw = np.random.default_rng(seed).uniform
    return [(draw(-4, 4), draw(-1, 1) ** 3, draw(-1, 1)) for _ in range(count)]


def _python(twin):
    """The functions of the module that is exported."""
    found = {"__name__": "made"}
    exec(write_as("compensation", twin, PYTHON).text, found)  # noqa: S102 - our own
    return found


@needs_cc
def test_c_python_and_our_own_law_are_one_law_for_every_kind_of_joint(tmp_path):
    twins = [_estimated(drawn(seed, kind)[0], seed) for seed, kind in enumerate(KINDS)]
    twins = [
        each if each.joint is JointKind.SLIDE else replace(each, added=ADDED) for each in twins
    ]
    names = [f"{twin.identifier}_compensation" for twin in twins]
    for twin, name in zip(twins, names, strict=True):
        (tmp_path / f"{name}.h").write_text(write_as("compensation", twin).text, encoding="ascii")
    source, made = tmp_path / "run.c", tmp_path / "run.so"
    source.write_text("".join(map(RUN.format, names)))
    compile_with("cc", "-std=c99", "-fPIC", "-c", source, "-o", tmp_path / "run.o")
    said("cc", "-shared", tmp_path / "run.o", "-o", made, "-lm")
    if shutil.which("c++"):
        compile_with("c++", "-x", "c++", "-fsyntax-only", source)
    library = ctypes.CDLL(str(made))
    for seed, (twin, name) in enumerate(zip(twins, names, strict=True)):
        law, python = Compensation.of(twin), _python(twin)
        for which in ("command", "error"):
            in_c = getattr(library, f"{which}_{name}")
            in_c.restype, in_c.argtypes = ctypes.c_double, 3 * [ctypes.c_double]
            for at in _points(seed):
                ours = sum(law.error(*at))
                if which == "command":
                    ours = limited(unlimited(*at, law.constants), law.constants)
                assert in_c(*at) == pytest.approx(ours, rel=1e-6, abs=1e-12), (name, which)
                assert python[which](*at) == pytest.approx(in_c(*at), rel=1e-6, abs=1e-12)
                assert which == "command" or ours > 0


@pytest.mark.parametrize("kind", KINDS)
def test_the_kernel_keeps_its_velocity_under_a_whole_compensation(kind):
    """Of a law without interval; torque of a lag and deflection of bristles as they settle."""
    twin = drawn(3, kind)[0]
    law = Compensation.of(replace(twin, limit=math.inf)).having(smoothing=1e-3)
    p, constants = twin.loaded, constants_of(twin.loaded)
    moving = [at for at in _points(3) if abs(at[1]) > 1e-3]
    assert len(moving) > 20
    for x, v, _ in moving:
        asked = unlimited(x, v, 0.0, law.constants)
        drive, sign = p.p4 * p.delivered(asked), np.sign(v)
        motor = drive - constants.back_emf * v
        level = friction_level(x, v, sign, motor, pull(x, constants), constants)
        bend = sign * level / constants.bristle_stiffness if constants.bristle_stiffness else 0.0
        rate, of_motor, of_bend = rates((x, v, motor, bend), drive, sign, constants)
        assert p.p1 * abs(rate) < 1e-9 * (abs(drive) + 1)
        assert abs(of_motor) + abs(of_bend) < 1e-6


def test_the_error_is_that_of_drawn_parameters_and_friction_is_withheld_to_its_lower_end():
    twin = _estimated(drawn(1, "stribeck")[0], 1, size=0.02)
    law, estimate = Compensation.of(twin), twin.estimate
    some = np.random.default_rng(0).multivariate_normal(estimate.values, estimate.covariance, 3000)
    others = [
        replace(twin.parameters, **dict(zip(estimate.names, each, strict=True)))
        for each in some.tolist()
    ]
    for x, v, way in ((1.0, 0.5, 1.0), (-2.0, -0.2, -1.0), (0.3, 0.0, 1.0)):
        withheld, half = law.error(x, v, way)
        whole = Compensation.of(replace(twin, estimate=None))
        drawn_commands = [
            unlimited(x, v, way, whole.having(**vars(each)).constants) for each in others
        ]
        assert np.std(drawn_commands) * SPREADS == pytest.approx(half, rel=0.06)
        given, *truly = (
            (steady_torque(x, v, way, c) - steady_torque(x, 0.0, 0.0, c)) / c.p4
            for c in (
                law.constants,
                *(whole.having(**vars(each)).constants for each in others),
            )
        )
        assert np.mean(np.abs(truly) > abs(given)) > 0.965
        assert withheld > 0


def test_near_standstill_friction_has_the_wanted_direction_and_commands_are_limited():
    made = _python(_estimated(drawn(1, "coulomb")[0]))
    command, p = made["command"], made["Parameters"]()
    stuck, rubs = p.dry * p.coulomb / p.p4, p.damping * p.p2 / p.p4
    for way in (-1.0, 0.0, 0.5, 1.0):
        assert command(0.0, 0.0, way) == pytest.approx(way * stuck)
        assert command(0.0, p.smoothing, way) - rubs * p.smoothing == pytest.approx(stuck)
    half = p.smoothing / 2
    assert command(0.0, half) - rubs * half == pytest.approx(stuck / 2)
    assert command(math.pi / 2, 0.0) == pytest.approx(p.p3 / p.p4)
    assert command(-math.pi / 2, 0.0, p=made["Parameters"](limit=0.1)) == -0.1
    assert command(math.pi / 2, 1e9) == p.limit


@pytest.mark.parametrize("noise", [1e-5, 3e-4, 3e-3])
def test_smoothing_is_the_error_of_the_best_difference_of_two_readings(noise):
    time, rng = 2e-3 * np.arange(20_000), np.random.default_rng(0)
    angle, velocity = 0.5 * np.sin(4 * time), 2 * np.cos(4 * time)
    measured = angle + noise * rng.standard_normal(time.size)
    log = Log(time=time, input=0 * time, angle=measured)
    parameters = LumpedParameters(p1=1.0, p2=0.0, p3=1.0, p4=1.0)
    run = FreeRun(log=log, simulated=angle)
    setting = SimpleNamespace(zero=0.0, simulation=lambda _: None, run=lambda _: run)
    twin = Twin(parameters=parameters, recorded=lambda: [(log, setting)])
    smoothing = Compensation.of(twin).numbers["smoothing"]
    errors = [
        (measured[k:] - measured[:-k]) / (k * 2e-3) - velocity[k:] for k in (1, 2, 5, 10, 20, 50)
    ]
    best = min(np.quantile(abs(error), 0.95) for error in errors)
    assert 0.7 * best < smoothing < 1.5 * best


def _identified(truth, seed):
    """What is learnt of a robot from short logs of MuJoCo."""
    encoder, pace = Encoder(steps=2**14, noise=2e-4), math.sqrt(truth.p3 / truth.p1)
    rig = Rig(robot=Robot.of_lumped(truth), clock=Clock(step=4e-3, jitter=5e-4), encoder=encoder)
    size = truth.coulomb * 4 / math.pi + 0.15 * truth.p3
    runs = [
        (mass, Sine(omega=share * pace, amplitude=size / truth.p4))
        for mass in (AddedMass(), AddedMass(mass=0.3 * truth.p1 / 0.01, arm=0.1))
        for share in (0.5, 0.7, 1.4)
    ]
    return bf.identify(DataSet.of(simulated(rig, runs, 8.0 + seed), name="held"))


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(k, marks=pytest.mark.slow) for k in range(2, 6))]
)
def test_what_is_left_in_mujoco_is_within_what_is_printed(seed):
    draw = np.random.default_rng([53, seed]).uniform
    p1, pace = 10 ** draw(-3, -2), draw(3, 8)
    p3 = p1 * pace**2
    truth = LumpedParameters(
        p1=p1, p2=0.05 * p1 * pace, p3=p3, p4=draw(0.02, 1), coulomb=p3 * draw(0.001, 0.02)
    )
    twin = _identified(truth, seed).model.twin()
    made, command = Compensation.of(twin), _python(twin)["command"]
    promised, _ = made.worst
    printed = write_as("compensation", twin).notes[1]
    assert f"Error at most {promised:.2g} unit ({truth.p4 * promised:.1g}"[:21] in printed
    model = mujoco.MjModel.from_xml_string(
        write_as("mjcf", replace(twin, parameters=truth, recorded=tuple)).text
    )
    data, zero, left = mujoco.MjData(model), made.numbers["zero"], []
    for x, v, way in made.everywhere:
        if abs(v) < made.numbers["smoothing"]:
            continue
        data.qpos[0], data.qvel[0], data.ctrl[0] = x - zero, v, command(x, v, way)
        mujoco.mj_forward(model, data)
        left.append(truth.p1 * abs(data.qacc[0]) / truth.p4)
    assert len(left) > 50
    assert max(left) < promised < 0.1 * made.most


def test_a_hand_that_floats_moves_when_pushed_and_stays_where_it_is_left():
    truth = LumpedParameters(p1=0.003, p2=1e-3, p3=0.05, p4=0.025, coulomb=1e-3)
    twin = _estimated(Twin(parameters=truth, kind=InputKind.VOLTAGE), size=0.01)
    made = _python(twin)
    guided = made["Parameters"](dry=0.5, damping=0.0)
    model = mujoco.MjModel.from_xml_string(write_as("mjcf", twin, Options(timestep=1e-3)).text)
    data, angles = mujoco.MjData(model), []
    data.qpos[0] = 1.0
    for k in range(8_000):
        data.qfrc_applied[0] = 0.02 * (1000 <= k < 1200)
        data.ctrl[0] = made["command"](data.qpos[0], data.qvel[0], p=guided)
        mujoco.mj_step(model, data)
        angles.append(data.qpos[0])
    assert abs(angles[999] - 1) < 1e-4
    assert angles[2000] > 1.5
    assert abs(data.qvel[0]) < 1e-3
    assert abs(angles[-1] - angles[-1000]) < 1e-3
    assert math.sin(angles[-1]) * truth.p3 > 2 * truth.coulomb


def _without_errors(twin):
    none = np.full(twin.estimate.covariance.shape, math.nan)
    return replace(twin, estimate=replace(twin.estimate, covariance=none))


def _undriven(twin):
    parameters = replace(twin.parameters, p4=0.0)
    return replace(twin, parameters=parameters, kind=InputKind.VOLTAGE)


@pytest.mark.parametrize(
    ("form", "change", "message"),
    [
        ("compensation", _without_errors, "without standard errors"),
        ("compensation", _undriven, "p4"),
        ("wpilib", replace, "voltage"),
        ("wpilib", _undriven, "p4"),
    ],
)
def test_what_is_missing_is_named(form, change, message):
    with pytest.raises(InputError, match=message):
        write_as(form, change(_estimated(drawn(1, "coulomb")[0])))


@pytest.mark.parametrize("kind", ["coulomb", "motor", "slide"])
def test_gains_of_wpilib_are_ratios_with_the_errors_of_ratios(kind):
    offset = {"p3_offset": 0.1} if kind == "motor" else {}
    twin = drawn(2, "slide" if kind == "slide" else "coulomb")[0]
    parameters = replace(
        twin.parameters, bias=-0.02 if kind == "slide" else 0.0, delay=0.0, **offset
    )
    if kind == "motor":
        parameters = replace(parameters, drag=1e-3)
    twin = _estimated(replace(twin, kind=InputKind.VOLTAGE, parameters=parameters), 2)
    written = write_as("wpilib", twin)
    content, p, estimate = json.loads(written.text), twin.parameters, twin.estimate
    gains = {name: each["value"] for name, each in content["gains"].items()}
    assert content["class"] == ("ElevatorFeedforward" if kind == "slide" else "ArmFeedforward")
    shift = math.pi / 2 - math.atan2(p.p3_offset, p.p3)
    for x, v, way in _points(2):
        acting = v or way
        volts = gains["kS"] * np.sign(acting) + gains["kV"] * acting + gains["kA"] * way
        volts += gains["kG"] * (1.0 if kind == "slide" else math.cos(x - shift))
        assert acceleration(p, x, acting, p.p4 * volts + p.bias) == pytest.approx(way)
    two = [estimate.names.index(name) for name in ("coulomb", "p4")]
    slopes = np.array([1 / p.p4, -p.coulomb / p.p4**2])
    half = SPREADS * math.sqrt(slopes @ estimate.covariance[np.ix_(two, two)] @ slopes)
    row = content["gains"]["kS"]
    assert (row["upper"] - row["lower"]) / 2 == pytest.approx(half, rel=1e-5)
    assert any("drag" in note for note in content["notes"]) == (p.drag > 0)
