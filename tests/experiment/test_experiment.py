import re

import numpy as np
import pytest
import yaml

from butterfly.errors import InputError
from butterfly.experiment.perform import perform
from butterfly.experiment.simulate import simulate, write_logs
from butterfly.experiment.source import read_experiment
from butterfly.files import shipped
from butterfly.identification.data import DataSet
from butterfly.identification.identify import identify
from butterfly.logs.manifest import read_manifest
from butterfly.logs.reading import read_entry
from butterfly.plant.sensors import Faults
from butterfly.report.identification_page import write_report

QUICKSTART = shipped("experiments/quickstart.yaml")


@pytest.fixture
def short(tmp_path):
    """The quick start with two added masses, two sines and two seconds."""
    content = yaml.safe_load(QUICKSTART.read_text())
    content.update(
        duration=2.0,
        added_masses=content["added_masses"][:2],
        excitations=content["excitations"][-2:],
    )
    path = tmp_path / "short.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def _identification(result):
    assert result.error is None
    (identification,) = result.identifications.values()
    return identification


@pytest.fixture(scope="module")
def quickstart():
    """The quick start with every other of its sines, each for 40 s; the wheel is tried on all."""
    experiment = read_experiment(QUICKSTART)
    few = {"excitations": experiment.excitations[::2], "duration": 40.0}
    return experiment, perform(experiment.model_copy(update=few))


def _written(experiment, folder):
    return read_manifest(write_logs(experiment, simulate(experiment), folder))


def test_the_quick_start_recovers_the_simulated_robot_within_one_percent(quickstart):
    experiment, performed = quickstart
    result = _identification(performed)
    truth = experiment.plant.robot.lumped
    found = result.estimate.parameters
    for name in ("p1", "p2", "p3", "p4"):
        assert getattr(found, name) == pytest.approx(getattr(truth, name), rel=0.01)
    assert result.fit.worst > 98


def test_simulated_logs_are_read_back_with_what_was_done(short, tmp_path):
    experiment = read_experiment(short)
    manifest = _written(experiment, tmp_path / "out")
    logs = [read_entry(manifest, entry) for entry in manifest.logs]
    assert [(log.added_mass, log.excitation) for log in logs] == experiment.runs()
    assert all(log.input_kind == "voltage" for log in logs)
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {".mat", ".yaml"}


def test_the_same_file_gives_the_same_logs_and_another_seed_others(short, tmp_path):
    def angles(seed, folder):
        short.write_text(re.sub(r"seed: \d+", f"seed: {seed}", short.read_text()))
        manifest = _written(read_experiment(short), tmp_path / folder)
        return np.concatenate([read_entry(manifest, entry).angle for entry in manifest.logs])

    np.testing.assert_array_equal(angles(1, "a"), angles(1, "b"))
    assert not np.array_equal(angles(1, "a"), angles(2, "c"))


def _set(content, path, value):
    *parents, last = path.split(".")
    for key in parents:
        content = content[int(key) if key.isdigit() else key]
    content[last] = value


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("plant.hand.mass", -0.1, "plant.hand.mass: got -0.1; expected a finite positive number"),
        ("plant.hand.mas", 0.1, "plant.hand.mas: got an unknown key; expected 'mass'"),
        (
            "added_masses.1.mass",
            -0.1,
            "added_masses.1.mass: got -0.1; expected a finite non-negative",
        ),
        ("excitations.0.omega", 0, "excitations.0.omega: got 0"),
        ("excitations.0.amplitude", "x", "excitations.0.amplitude: got 'x'"),
        ("excitatons", [], "excitatons: got an unknown key; expected 'excitations'"),
        ("plant.drive.torque", {"gain": 1}, "plant.drive: got"),
        ("plant.clock.jitter", 0.1, "plant.clock.jitter: got 0.1; expected between 0 and half"),
        ("plant.encoder.steps", 0, "plant.encoder.steps: got 0"),
        ("duration", float("inf"), "duration: got inf"),
        ("duration", -3, "duration: got -3"),
        ("seed", -1, "seed: got -1"),
        ("name", "a/../b", "name: got 'a/../b'"),
        ("method", "magic", "method: got 'magic'; expected 'harmonic-balance'"),
        ("added_masses", [], "added_masses: got []"),
        ("added_masses.1.joint", "slide", "added_masses: got 50 g on a slide under 0 m/s²"),
        ("added_masses.1.gravity", 3.7, "under 3.7 m/s²; expected masses on a hinge under 9.81"),
        ("plant.friction.drag", -1.0, "plant.friction.drag: got -1.0; expected a finite non-neg"),
        ("plant.friction.dreg", 1.0, "plant.friction.dreg: got an unknown key; expected 'drag'"),
        ("plant.hand.tilt", 2.0, "plant.hand.tilt: got 2.0; expected less than pi/2"),
        ("plant.clutch", {"backlash": 0.1, "rotor_inertia": 1.0}, "rotor_inertia: got 1.0"),
    ],
)
def test_a_slip_in_an_experiment_is_named_with_file_field_and_value(
    tmp_path, field, value, message
):
    content = yaml.safe_load(QUICKSTART.read_text())
    _set(content, field, value)
    path = tmp_path / "bad.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        read_experiment(path)
    assert str(path) in str(caught.value)


def test_every_effect_of_a_real_bench_can_be_asked_for(short, tmp_path):
    content = yaml.safe_load(short.read_text())
    plant = content["plant"]
    plant["hand"] |= {"com_offset": 0.002, "tilt": 0.05}
    plant["friction"] |= {
        "load": 1e-4,
        "stribeck": 2e-4,
        "stribeck_velocity": 0.2,
        "drag": 1e-5,
        "bias": 1e-3,
        "cogging": 1e-3,
        "cogging_periods": 1,
    }
    plant["clutch"] = {"backlash": 0.01, "rotor_inertia": 1e-4}
    plant["faults"] = {"dropped": 0.1, "duplicated": 0.1}
    short.write_text(yaml.safe_dump(content))
    for step in (0.001, 0.005):
        plant["clock"] = {"step": step}
        short.write_text(yaml.safe_dump(content))
        manifest = _written(read_experiment(short), tmp_path / str(step))
        log = read_entry(manifest, manifest.logs[0])
        assert np.isfinite(log.angle).all()
        assert np.ptp(log.angle) > 0.01
        assert 0.85 < np.unique(log.time).size / (2.0 / step + 1) < 0.95
        assert log.time.size > 1.05 * np.unique(log.time).size


def test_yaml_that_builds_objects_is_not_obeyed(tmp_path):
    path = tmp_path / "evil.yaml"
    path.write_text("name: !!python/object/apply:os.system ['true']")
    with pytest.raises(InputError, match="valid YAML"):
        read_experiment(path)


def test_every_shipped_experiment_reads():
    folder = shipped("experiments")
    data_sets = {"real-logs.yaml"}
    for path in folder.rglob("*.yaml"):
        if path.name not in data_sets:
            read_experiment(path)


def test_other_inputs_than_sines_are_simulated_and_said_not_to_be_sines(short, tmp_path):
    (tmp_path / "input.csv").write_text("t,volts\n0,0.1\n1,-0.1\n")
    content = yaml.safe_load(short.read_text())
    content["excitations"] = []
    content["signals"] = [
        {"multisine": {"base": 0.5, "harmonics": [3, 5, 8], "peak": 0.2}},
        {"free_decay": {"angle": 0.5}},
        {"file": {"path": "input.csv", "time": "t", "values": "volts"}},
    ]
    short.write_text(yaml.safe_dump(content))
    manifest = _written(read_experiment(short), tmp_path / "out")
    logs = [read_entry(manifest, entry) for entry in manifest.logs]
    assert len(logs) == 6
    assert all(log.excitation is None for log in logs)
    assert logs[1].angle[0] == pytest.approx(0.5, abs=1e-3)
    assert set(logs[2].input) == {0.1, -0.1}


@pytest.mark.parametrize(
    ("signals", "message"),
    [
        ([{"chirp": {}, "prbs": {}}], "signals.0.chirp.start: got nothing"),
        ([{}], "signals.0: got {}; expected exactly one of the keys stepped_sine"),
        ([{"file": {"path": "nowhere.csv"}}], "nowhere.csv: path: got no such file"),
        (
            [{"prbs": {"amplitude": 1, "bit": 0.1, "register": 99}}],
            "signals.0.prbs.register: got 99",
        ),
        ([], "at least one of the keys excitations, signals and control.believed"),
    ],
)
def test_a_slip_in_a_signal_is_named(short, signals, message):
    content = yaml.safe_load(short.read_text())
    content.update(excitations=[], signals=signals)
    short.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=re.escape(message)):
        read_experiment(short)


def test_sines_that_will_swing_wide_are_found_beforehand(short):
    content = yaml.safe_load(short.read_text())
    content["excitations"] = [{"omega": 3.9, "amplitude": 0.5}, {"omega": 20, "amplitude": 0.1}]
    short.write_text(yaml.safe_dump(content))
    (run,) = [run for run in read_experiment(short).wide_swings() if run[0].mass == 0]
    assert run[1].omega == 3.9
    assert run[2] > 1.0
    assert read_experiment(QUICKSTART).wide_swings() == []


def test_lost_and_repeated_samples_are_counted_and_leave_the_estimate_right(quickstart):
    experiment, performed = quickstart
    faults, rng = Faults(dropped=0.005, duplicated=0.002), np.random.default_rng(0)
    logs = [faults.apply(log, rng) for log in performed.logs]
    result = identify(DataSet.of(logs))
    assert all(health.duplicate_stamps > 20 for health in result.data.health)
    assert any(health.gaps > 0 for health in result.data.health)
    truth = experiment.plant.robot.lumped
    for name in ("p1", "p2", "p3", "p4"):
        found = getattr(result.estimate.parameters, name)
        assert found == pytest.approx(getattr(truth, name), rel=0.01)


def test_a_robot_is_identified_from_a_multisine_and_a_free_decay(tmp_path):
    content = yaml.safe_load(QUICKSTART.read_text())
    del content["excitations"]
    content.update(
        duration=20.0,
        added_masses=content["added_masses"][:2],
        signals=[
            {"multisine": {"base": 0.5, "harmonics": [3, 5, 8, 11, 14], "peak": 0.4, "seed": 0}},
            {"free_decay": {"angle": 0.5}},
        ],
        method="output-error",
        terms=["drag"],
    )
    path = tmp_path / "signals.yaml"
    path.write_text(yaml.safe_dump(content))
    experiment = read_experiment(path)
    result = _identification(perform(experiment))
    truth, found = experiment.plant.robot.lumped, result.estimate.parameters
    for name in ("p1", "p2", "p3", "p4"):
        assert getattr(found, name) == pytest.approx(getattr(truth, name), rel=5e-3)
    assert result.fit.worst > 99
    write_report(result, tmp_path / "report.html", truth)
    assert "signal" in (tmp_path / "report.html").read_text(encoding="utf-8")
