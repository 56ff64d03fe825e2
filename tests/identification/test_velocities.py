"""Joints that other laboratories have: slides, wheels, decays, and logs of velocities alone."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import butterfly as bf
from butterfly.api.comparison import change_answer
from butterfly.comparison.three_way import compare_three
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, OutputError, WeakForm
from butterfly.identification.identified import given_estimate
from butterfly.logs.health import examine
from butterfly.logs.log import InputKind, Log, Sine
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.model.prior import Prior
from butterfly.plant.robot import Robot
from butterfly.report.inspection import health_rows
from butterfly.report.summary import summary
from tests.benchmarks.kinds import score
from tests.identification.simulated import cells, driven, next_runs, noisy
from tests.independent.integrator import Joint, motion

METHODS = ("output-error", "weak-form")
PLAIN = OutputError(terms=(), workers=1)
JOINT = Joint(2e-3, 4e-4, 0.0, 0.05, coulomb=1.5e-3, delay=0.004)
MASSES = [AddedMass(gravity=0.0), AddedMass(mass=0.1, arm=0.1, gravity=0.0)]
TIME = 4e-3 * np.arange(1500)
NOISE = 0.2  # rad/s


def _logs(seed=0, start=0.0, noise=NOISE, **about):
    """Two logs of each mass, by an integrator of its own, of angle and of velocity."""
    rng, found = np.random.default_rng(seed), []
    for mass in (*MASSES, *MASSES):
        joint = JOINT._replace(inertia=JOINT.inertia + mass.inertia)
        inputs = np.repeat(rng.uniform(-1, 1, 15), 100) * (not start)
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


@pytest.mark.parametrize("estimator", [PLAIN, WeakForm(terms=())])
def test_without_noise_velocities_tell_what_angles_do(estimator):
    angles, velocities = _logs(noise=0.0)
    values = [estimator(DataSet.of(logs)).parameters for logs in (angles, velocities)]
    for name in ("p1", "p2", "p4", "coulomb", "delay"):
        assert getattr(values[1], name) == pytest.approx(getattr(values[0], name), rel=0.02)


@pytest.fixture(scope="module")
def found(wheel):
    return bf.identify(wheel, PLAIN)


def test_what_a_free_run_leaves_is_the_noise_of_the_velocity_not_its_integral(found):
    sensor = [log.sensor.noise for log in found.residuals.logs]
    np.testing.assert_allclose(sensor, NOISE, rtol=0.05)
    np.testing.assert_allclose([run.rms for run in found.free_runs], NOISE, rtol=0.05)
    assert found.residuals.times == pytest.approx(1.0, abs=0.1)
    assert "reproduces the measured velocity (no angle was recorded)" in str(found)


def test_predictions_and_simulations_are_of_the_velocity(wheel, found):
    predicted = bf.predict(wheel, found, draws=40).predictions[0]
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
    found = PLAIN(DataSet.of(logs, known=known))
    assert found.parameters.p1 == pytest.approx(2e-3, rel=0.02)


def test_terms_are_selected_from_those_that_need_no_angle(wheel):
    passed = bf.select(wheel[:2], "output-error").rows()
    assert passed[0]["terms"] == []


def test_pieces_in_other_units_are_read_from_files(wheel, tmp_path):
    columns = (1e3 * TIME, wheel[0].input, -60 / (2 * np.pi) * wheel[0].velocity)
    rows = np.column_stack(columns)
    np.savetxt(tmp_path / "a.txt", rows, "%.9g", ";", header="t [ms];u;n [rpm]", comments="")
    logs = "logs: [{file: a.txt, from: 1, to: 3}, {file: a.txt, from: 3.5}]"
    (tmp_path / "manifest.yaml").write_text(
        "name: a\ninput: torque\ngravity: 0\nknown: {p4: 0.05}\nunits: {velocity: -1}\n"
        f"columns: {{time: t, input: u, velocity: n}}\n{logs}\n"
    )
    data = bf.read(tmp_path)
    np.testing.assert_allclose(data.logs[0].velocity, wheel[0].velocity[250:751], rtol=1e-6)
    assert data.logs[1].initial_state.velocity == pytest.approx(wheel[0].velocity[875], abs=0.6)
    found = bf.identify(data, PLAIN)
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


SLIDE = AddedMass(joint=JointKind.SLIDE)


def _driven(joint, *inputs, angle=0.0, added=SLIDE, noise=1e-5):
    exact = [
        driven(joint, 4e-3 * np.arange(each.size), each, angle, added_mass=added) for each in inputs
    ]
    return noisy(exact, noise, np.random.default_rng(3))


@pytest.fixture(scope="module")
def slide():
    levels = np.repeat([0.8, -1.0, 0.3, 1.0, -0.9, -0.4, 0.7, -0.6], 190)
    logs = _driven(Joint(2.0, 4.0, 0.0, 3.0, coulomb=0.5), levels, levels[::-1].copy())
    return DataSet.of(logs, known=Prior.of({"p4": 3.0}))


def test_a_wheel_that_runs_on_is_identified_from_steps_of_one_sign():
    """It never turns back, and where Stribeck friction would act is not among its speeds."""
    steps = np.repeat([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 250)
    logs = _driven(Joint(1.2e-4, 6.57e-4, 0.0, 0.01565, coulomb=2e-3), steps, added=AddedMass())
    known = Prior.of({"p3": 0.0, "p4": 0.01565})
    estimate = PLAIN(DataSet.of(logs, known=known))
    assert estimate.parameters.p1 == pytest.approx(1.2e-4, rel=0.01)
    assert estimate.parameters.coulomb == pytest.approx(2e-3, rel=0.01)


def test_a_small_mass_on_a_heavy_slide_tells_the_scale_to_simulations():
    """Of a tenth of what moves; a closed form takes it for noise, and finds no inertia."""
    rng = np.random.default_rng(0)
    joint = Joint(4.0, 0.9, 0.0, 0.15, coulomb=4e-4)
    logs = []
    for added in (SLIDE, replace(SLIDE, mass=0.4)):
        loaded = joint._replace(inertia=joint.inertia + added.mass)
        wave = np.cumsum(rng.standard_normal((2, 3000)), axis=1) * 0.02
        logs += _driven(loaded, *wave, added=added, noise=1e-3)
    data = DataSet.of(logs)
    closed = WeakForm(terms=(), half_width=0.25)(data).parameters
    assert not closed.p1 > 0
    found = PLAIN(data).parameters
    assert found.p1 == pytest.approx(4.0, rel=0.02)
    assert found.p4 == pytest.approx(0.15, rel=0.02)


def test_logs_that_tell_nothing_of_a_parameter_are_refused():
    silent = cells(("p1", "p4"), np.zeros((8, 1, 2)), np.zeros((8, 1)))
    with pytest.raises(IdentifiabilityError, match="add logs at other speeds"):
        silent.conditioning.require()


def test_only_what_the_user_gave_is_called_given(slide):
    said = summary(bf.identify(slide, PLAIN))
    assert "Given: p4 = 3." in said
    assert any(each.startswith("From the recorded input alone, the model") for each in said)
    assert "Assumed: p3 = 0 (no gravity acts)." in said
    both = bf.identify(slide.knowing(Prior.of({"p3": 0.0})), PLAIN)
    assert "Given: p4 = 3, p3 = 0." in summary(both)


def test_a_known_gain_of_the_wrong_sign_is_named(slide):
    told = slide.knowing(Prior.of({"p4": -3.0}))
    with pytest.raises(IdentifiabilityError, match=r"p4 = -3.*inertia would be -2"):
        PLAIN(told)
    with pytest.raises(IdentifiabilityError, match=r"opposite directions.*--units input=-1,"):
        bf.identify(told, PLAIN)


def test_free_decays_need_no_delay_to_be_known():
    joint, still = Joint(7.6e-3, 2.4e-3, 0.21, 1.0, 1.5e-3), np.zeros(2000)
    logs = [
        *_driven(joint, still, angle=0.9, added=AddedMass()),
        *_driven(joint, still, angle=-0.6, added=AddedMass()),
    ]
    for gain in (1.0, 0.0):
        known = Prior.of({"p3": 0.21, "p4": gain})
        estimate = PLAIN(DataSet.of(logs, known=known))
        assert estimate.parameters.p1 == pytest.approx(7.6e-3, rel=1e-3)
        assert estimate.fixed["delay"] == 0.0
    free = [replace(log, input_kind=InputKind.NONE) for log in logs]
    found = bf.identify(DataSet.of(free, known=Prior.of({"p3": 0.21})), PLAIN)
    np.testing.assert_array_equal(found.estimate.values, estimate.values)
    assert "p4, delay cannot be estimated" in " ".join(summary(found))
    assert any(each.startswith("From the start alone, the model") for each in summary(found))
    assert {row.name for row in found.estimate.table()} == {"p1", "p2", "coulomb", "p3"}
    for use in (
        partial(Robot.of_lumped, found.parameters),
        partial(next_runs, DataSet.of(free), found.estimate),
    ):
        with pytest.raises(InputError, match=r"p4: got 0 \(no log is driven\)"):
            use()
    (seen,) = compare_three(DataSet.of(free[:1]), found.estimate, [0])
    assert seen.fits["MuJoCo"] > 99


def test_what_is_told_of_a_slide_is_in_its_units_and_completed_by_what_is_known(slide):
    given = given_estimate({"p1": 2.0, "p2": 4.0, "coulomb": 0.5}, "test", data=slide)
    assert (given.parameters.p3, given.parameters.p4) == (0.0, 3.0)
    rows = dict(health_rows(*examine(slide.logs[0])))
    assert rows["angle"].endswith(" m")
    assert "rad" not in rows["amplitude"]
    found = bf.identify(slide, WeakForm(terms=()))
    units = {row["parameter"]: row["unit"] for row in change_answer(found, found).rows()}
    assert (units["p1"], units["p2"], units["coulomb"]) == ("kg", "N s/m", "N")


def test_a_slide_is_not_driven_further_than_its_logs_have_shown(slide):
    way = max(np.ptp(log.angle) for log in slide.logs) / 2
    ranked = [each.recipe for each in next_runs(slide, WeakForm(terms=())(slide))]
    assert not any("decay" in each.what for each in ranked)
    trusted = [each for each in ranked if not each.warning]
    assert trusted
    assert all(each.swing <= way for each in trusted)
    assert all(each.warning.endswith(" m") for each in ranked if "swings" in each.warning)
