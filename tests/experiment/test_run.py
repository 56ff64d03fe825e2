"""Simulated logs are what was asked for, and lead back to the robot that made them."""

import numpy as np
import pytest

from butterfly.api.identification import Identification
from butterfly.experiment.run import perform, planned_logs, simulate, write_logs
from butterfly.experiment.source import read_experiment
from butterfly.files import shipped
from butterfly.identification.data import DataSet
from butterfly.identification.identify import identify
from butterfly.logs.log import SAMPLED
from butterfly.logs.manifest import read_manifest
from butterfly.logs.reading import read_entry
from butterfly.plant.rig import Simulator
from butterfly.plant.rollout import simulate_runs
from butterfly.plant.sensors import Faults
from tests.experiment.setting import SHIPPED, changed, written

QUICKSTART = shipped("experiments/quickstart.yaml")
PRINCIPAL = ("p1", "p2", "p3", "p4")


@pytest.fixture
def short(tmp_path):
    """The quick start with two added masses, two sines and two seconds, not run in."""
    some = {key: SHIPPED[key][-2:] for key in ("added_masses", "excitations")}
    some["plant"] = SHIPPED["plant"] | {"run_in": 0.0}
    return written(tmp_path / "short.yaml", **SHIPPED | some | {"duration": 2.0})


@pytest.fixture(scope="module")
def quickstart():
    """The quick start with every third of its sines, run in for half as long."""
    experiment = read_experiment(QUICKSTART)
    few = {"excitations": experiment.excitations[::3], "duration": 10.0}
    few["plant"] = experiment.plant.model_copy(update={"run_in": 30.0})
    return experiment.plant.robot.lumped, perform(experiment.model_copy(update=few))


def _logs(path, folder):
    """Write the logs of an experiment, and read them back."""
    experiment = read_experiment(path)
    manifest = read_manifest(write_logs(experiment, simulate(experiment), folder))
    return [read_entry(manifest, entry) for entry in manifest.logs]


def _assert_found(identification, truth, share):
    for name in PRINCIPAL:
        found = getattr(identification.estimate.parameters, name)
        assert found == pytest.approx(getattr(truth, name), rel=share)


def test_the_quick_start_recovers_the_simulated_robot_within_one_percent(quickstart):
    truth, performed = quickstart
    assert performed.error is None
    (identification,) = performed.identifications.values()
    _assert_found(identification, truth, 0.01)
    assert identification.fit.worst > 98


def test_lost_and_repeated_samples_are_counted_and_leave_the_estimate_right(quickstart):
    truth, performed = quickstart
    faults, rng = Faults(dropped=0.005, duplicated=0.002), np.random.default_rng(0)
    result = identify(DataSet.of([faults.apply(log, rng) for log in performed.logs]))
    assert all(health.duplicate_stamps > 8 for health in result.data.health)
    assert any(health.gaps > 0 for health in result.data.health)
    _assert_found(result, truth, 0.01)


def test_simulated_logs_are_read_back_with_what_was_done_and_a_seed_fixes_them(short, tmp_path):
    logs, again, others = (
        _logs(changed(short, seed=seed), tmp_path / folder)
        for seed, folder in ((1, "out"), (1, "again"), (2, "other"))
    )
    assert [(log.added_mass, log.excitation) for log in logs] == read_experiment(short).runs()
    assert all(log.input_kind == "voltage" for log in logs)
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {".mat", ".yaml"}
    for log, same, other in zip(logs, again, others, strict=True):
        np.testing.assert_array_equal(log.angle, same.angle)
        assert not np.array_equal(log.angle, other.angle)


def test_every_effect_of_a_real_bench_can_be_asked_for(short, tmp_path):
    plant = SHIPPED["plant"] | {"run_in": 0.0}
    friction = {"load": 1e-4, "stribeck": 2e-4, "stribeck_velocity": 0.2, "drag": 1e-5}
    friction |= {"bias": 1e-3, "cogging": 1e-3, "cogging_periods": 1}
    bench = plant | {
        "hand": plant["hand"] | {"com_offset": 0.002, "tilt": 0.05},
        "friction": plant["friction"] | friction,
        "clutch": {"backlash": 0.01, "rotor_inertia": 1e-4},
        "faults": {"dropped": 0.1, "duplicated": 0.1},
    }
    for step in (0.001, 0.005):
        path = changed(short, plant=bench | {"clock": {"step": step}}, added_masses=[{}])
        log = _logs(path, tmp_path / str(step))[0]
        assert np.isfinite(log.angle).all()
        assert np.ptp(log.angle) > 0.01
        assert 0.85 < np.unique(log.time).size / (2.0 / step + 1) < 0.95
        assert log.time.size > 1.05 * np.unique(log.time).size


def test_a_servo_is_simulated_in_its_loop_written_with_it_and_identified_from_its_logs(tmp_path):
    experiment = read_experiment("servo")
    few = {"signals": experiment.signals[:1], "duration": 4.7}
    performed = perform(experiment.model_copy(update=few))
    (identification,) = performed.identifications.values()
    for name in (*PRINCIPAL, "back_emf", "motor_friction", "load_friction"):
        truth = getattr(experiment.plant.robot.lumped, name)
        assert getattr(identification.estimate.parameters, name) == pytest.approx(truth, rel=0.01)
    path = write_logs(experiment, performed.logs, tmp_path)
    manifest = read_manifest(path)
    assert manifest.input == "setpoint"
    for log, entry in zip(performed.logs, manifest.logs, strict=True):
        again = read_entry(manifest, entry)
        assert again.servo == log.servo == experiment.plant.servo
        assert set(again.columns()) == {*SAMPLED, "supply", "enabled"}
        assert set(again.enabled) == {0.0, 1.0}
        for name, column in again.columns().items():
            np.testing.assert_array_equal(column, log.columns()[name])
    (planned, *_) = planned_logs(experiment.model_copy(update=few))
    assert planned.closed
    assert planned.input_kind == experiment.input_kind == identification.data.input_kind


def test_other_inputs_than_sines_are_simulated_and_said_not_to_be_sines(short, tmp_path):
    (tmp_path / "input.csv").write_text("t,volts\n0,0.1\n1,-0.1\n")
    signals = [
        {"multisine": {"base": 0.5, "harmonics": [3, 5, 8], "peak": 0.2}},
        {"free_decay": {"angle": 0.5}},
        {"file": {"path": "input.csv", "time": "t", "values": "volts"}},
    ]
    logs = _logs(changed(short, excitations=[], signals=signals), tmp_path / "out")
    assert len(logs) == 6
    assert all(log.excitation is None for log in logs)
    assert logs[1].angle[0] == pytest.approx(0.5, abs=1e-3)
    assert set(logs[2].input) == {0.1, -0.1}


def test_a_robot_is_identified_from_a_multisine_and_a_free_decay(short, tmp_path):
    multisine = {"base": 0.5, "harmonics": [3, 5, 8, 11, 14], "peak": 0.4, "seed": 0}
    signals = [{"multisine": multisine}, {"free_decay": {"angle": 0.5}}]
    about = {"duration": 6.0, "method": "output-error", "terms": ["drag"]}
    about["plant"] = SHIPPED["plant"] | {"simulator": "grey-box", "clock": {"step": 0.004}}
    masses = SHIPPED["added_masses"][:2]
    changed(short, excitations=[], signals=signals, added_masses=masses, **about)
    experiment = read_experiment(short)
    performed, truth = perform(experiment), experiment.plant.robot.lumped
    (identification,) = performed.identifications.values()
    _assert_found(identification, truth, 5e-3)
    assert identification.fit.worst > 99
    Identification.of(identification).report(tmp_path / "report.html")


def test_a_plant_may_be_lumped_and_simulated_by_either(tmp_path):
    lumped = {"p1": 0.003, "p2": 1e-3, "p3": 0.05, "p4": 10.0, "coulomb": 1e-4}
    about = {"name": "l", "duration": 6.0, "added_masses": [{"mass": 0.05, "arm": 0.1}]}
    about["excitations"] = [{"omega": 3.0, "amplitude": 1e-3}]
    logs = {}
    for simulator in Simulator:
        plant = {"lumped": lumped, "simulator": str(simulator)}
        experiment = read_experiment(written(tmp_path / "l.yaml", **about, plant=plant))
        assert experiment.plant.robot.lumped.p3 == pytest.approx(0.05)
        seeds = np.random.SeedSequence(0).spawn(1)
        runs = simulate_runs(experiment.plant.rig, experiment.runs(), experiment.duration, seeds)
        (logs[simulator],) = runs
    mujoco, grey_box = logs[Simulator.MUJOCO], logs[Simulator.GREY_BOX]
    assert np.abs(mujoco.angle - grey_box.angle).max() < 2e-3
    assert grey_box.source == "grey box"
