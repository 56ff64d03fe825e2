"""Logs without an angle, where none matters: the velocity is what is followed."""

from dataclasses import replace

import numpy as np
import pytest

import butterfly as bf
from butterfly.errors import InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, OutputError, WeakForm
from butterfly.logs.log import InputKind, Log, Sine
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import Prior
from tests.benchmarks.kinds import score
from tests.independent.integrator import Joint, motion

METHODS = ("output-error", "weak-form")
JOINT = Joint(2e-3, 4e-4, 0.0, 0.05, coulomb=1.5e-3, delay=0.004)
MASSES = [AddedMass(gravity=0.0), AddedMass(mass=0.1, arm=0.1, gravity=0.0)]
TIME = 4e-3 * np.arange(4000)
NOISE = 0.2  # rad/s


def _logs(seed=0, start=0.0, noise=NOISE, **about):
    """Two logs of each mass, by an integrator of its own, of angle and of velocity."""
    rng, found = np.random.default_rng(seed), []
    for mass in (*MASSES, *MASSES):
        joint = JOINT._replace(inertia=JOINT.inertia + mass.inertia)
        inputs = np.repeat(rng.uniform(-1, 1, 40), 100) * (not start)
        angle, velocity = motion(joint, TIME, inputs, 0.0, start)
        seen = velocity + noise * rng.standard_normal(TIME.size)
        kind = {"input_kind": InputKind.TORQUE, "added_mass": mass} | about
        found.append((Log(TIME, inputs, angle, **kind), Log(TIME, inputs, velocity=seen, **kind)))
    return [[*each] for each in zip(*found, strict=True)]


@pytest.fixture(scope="module")
def wheel():
    return _logs()[1]


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_joints_of_which_a_tachometer_saw_the_velocity_are_covered(method):
    scores = [score("tachometer", number, method, 7) for number in range(9)]
    assert [each.refused for each in scores] == [""] * 9
    readings = [each for one in scores for each in one.readings.values()]
    assert np.mean([each.covered for each in readings]) >= 0.9
    assert not any(each.false_claim for each in readings)


@pytest.mark.parametrize("estimator", [OutputError(terms=(), workers=1), WeakForm(terms=())])
def test_without_noise_velocities_tell_what_angles_do(estimator):
    angles, velocities = _logs(noise=0.0)
    values = [estimator(DataSet.of(logs)).parameters for logs in (angles, velocities)]
    for name in ("p1", "p2", "p4", "coulomb", "delay"):
        assert getattr(values[1], name) == pytest.approx(getattr(values[0], name), rel=0.02)


def test_what_a_free_run_leaves_is_the_noise_of_the_velocity_not_its_integral(wheel):
    found = bf.identify(wheel, OutputError(terms=(), workers=1))
    sensor = [log.sensor.noise for log in found.residuals.logs]
    np.testing.assert_allclose(sensor, NOISE, rtol=0.05)
    np.testing.assert_allclose([run.rms for run in found.free_runs], NOISE, rtol=0.05)
    assert found.residuals.times == pytest.approx(1.0, abs=0.1)
    assert "reproduces the measured velocity (no angle was recorded)" in str(found)


def test_predictions_and_simulations_are_of_the_velocity(wheel):
    found = bf.identify(wheel, OutputError(terms=(), workers=1))
    predicted = bf.predict(wheel, found, draws=400).predictions[0]
    assert predicted.bands["new log"].share(predicted.measured) > 0.85
    simulated = found.model.simulate(wheel[0])
    assert simulated.integrated
    assert np.std(simulated.velocity - wheel[0].velocity) == pytest.approx(NOISE, rel=0.05)


@pytest.mark.parametrize("method", METHODS)
def test_a_wheel_that_runs_down_needs_neither_angle_nor_input(method):
    logs = _logs(start=40.0, noise=0.02, input_kind=InputKind.NONE)[1]
    own = logs[0].initial_state.velocity
    assert own == pytest.approx(40.0, abs=0.2)
    found = bf.identify(logs, method, terms=())
    assert found.parameters.p1 == pytest.approx(2e-3, rel=0.02)
    assert found.parameters.coulomb == pytest.approx(1.5e-3, rel=0.05)
    assert "p4" not in {row["parameter"] for row in found.rows()}


def test_samples_are_dropped_and_averaged_before_the_velocity_is_integrated(wheel):
    holed = replace(
        wheel[0], velocity=np.where(np.arange(TIME.size) == 7, np.nan, wheel[0].velocity)
    )
    assert np.isnan(holed.angle[-1])
    data = DataSet.of([holed], repairs=frozenset({"non_finite"}))
    (log,), (health,) = data.logs, data.health
    assert health.non_finite == 1
    assert np.isfinite(log.angle).all()
    assert health.findings[1] == "no angle recorded: the velocity is fitted instead"
    assert log.angle[-1] == pytest.approx(wheel[0].angle[-1], abs=0.01)


GRAVITY = {"added_mass": AddedMass()}


@pytest.mark.parametrize(
    ("estimator", "known", "about", "needed"),
    [
        (WeakForm(), {}, GRAVITY, "gravity"),
        (OutputError(), {"p3": 0.01}, GRAVITY, "p3"),
        (WeakForm(), {"spring": 0.1}, {}, "spring"),
        (WeakForm(terms=("spring",)), {}, {}, "spring"),
        (OutputError(terms=("cogging",)), {}, {}, "cogging"),
        (OutputError(per_log=("zero",)), {}, {}, "zero"),
        (HarmonicBalance(), {}, {}, "harmonic-balance"),
    ],
)
def test_what_depends_on_the_angle_is_refused_by_name(wheel, estimator, known, about, needed):
    logs = [replace(log, **about) for log in wheel]
    with pytest.raises(
        InputError, match=f"angle: got only a velocity; expected .*which {needed} needs"
    ):
        bf.identify(bf.read(logs, known={"p4": 0.05} | known), estimator)


def test_a_balanced_joint_says_that_gravity_does_nothing(wheel):
    logs = [replace(log, added_mass=AddedMass()) for log in wheel[::2]]
    known = Prior.of({"p3": 0.0, "p4": 0.05})
    found = OutputError(terms=(), workers=1)(DataSet.of(logs, known=known))
    assert found.parameters.p1 == pytest.approx(2e-3, rel=0.02)


def test_terms_are_selected_from_those_that_need_no_angle(wheel):
    passed = bf.select(wheel, "weak-form").rows()
    assert passed[0]["terms"] == []


def test_pieces_in_other_units_are_read_from_files(wheel, tmp_path):
    columns = (1e3 * TIME, wheel[0].input, -60 / (2 * np.pi) * wheel[0].velocity)
    rows = np.column_stack(columns)
    np.savetxt(tmp_path / "a.txt", rows, "%.9g", ";", header="t [ms];u;n [rpm]", comments="")
    logs = "logs: [{file: a.txt, from: 2, to: 9}, {file: a.txt, from: 9.5}]"
    (tmp_path / "manifest.yaml").write_text(
        "name: a\ninput: torque\ngravity: 0\nknown: {p4: 0.05}\nunits: {velocity: -1}\n"
        f"columns: {{time: t, input: u, velocity: n}}\n{logs}\n"
    )
    data = bf.read(tmp_path)
    np.testing.assert_allclose(data.logs[0].velocity, wheel[0].velocity[500:2251], rtol=1e-6)
    assert data.logs[1].initial_state.velocity == pytest.approx(wheel[0].velocity[2375], abs=0.6)
    found = bf.identify(data, OutputError(terms=(), workers=1))
    assert found.parameters.p1 == pytest.approx(2e-3, rel=0.02)


def test_sines_of_velocities_have_no_phasor_and_are_simulated(wheel):
    sine = Sine(omega=3.0, amplitude=0.6)
    inputs = sine.sample(TIME)
    logs = []
    for log in wheel[:2]:
        joint = JOINT._replace(inertia=JOINT.inertia + log.added_mass.inertia)
        velocity = motion(joint, TIME, inputs)[1]
        logs.append(replace(log, input=inputs, velocity=velocity, excitation=sine))
    data = DataSet.of(logs)
    assert data.sines == []
    assert bf.identify(data, terms=()).estimate.method == "output error"
