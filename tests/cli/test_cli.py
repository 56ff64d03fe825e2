import mujoco
import numpy as np
import pytest
import yaml
from scipy.io import loadmat, savemat

from butterfly import __version__
from butterfly.logs.mat import write_mat


@pytest.fixture
def log_file(sine_log, tmp_path):
    write_mat(sine_log, tmp_path / "log.mat")
    return tmp_path / "log.mat"


def _assert_one_line_error(result, *parts):
    code, _, err = result
    assert code == 2
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    for part in parts:
        assert str(part) in err


def test_the_version_is_printed(butterfly):
    assert butterfly("--version") == (0, f"butterfly {__version__}\n", "")


COMMANDS = (
    *("identify", "simulate", "run", "inspect", "manifest", "model", "view", "video"),
    *("validate", "select", "residual", "design", "reproduce", "calibrate-orbit"),
)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(butterfly, command):
    code, out, _ = butterfly(command, "--help")
    assert code == 0
    assert len(out) > 400


def test_run_prints_true_and_estimated_parameters_and_writes_a_report(butterfly, quick, tmp_path):
    code, out, err = butterfly("run", quick, "--out", tmp_path / "out")
    assert (code, err) == (0, "")
    assert "0.00325" in out
    assert "deviation" in out
    assert (tmp_path / "out/report.html").stat().st_size > 1e6


def test_simulated_logs_are_identified_like_any_folder(butterfly, quick, tmp_path):
    folder = tmp_path / "logs"
    assert butterfly("simulate", quick, "--out", folder)[0] == 0
    code, out, _ = butterfly("identify", folder, "--against", "p1=0.004,p2=0.001,p3=0.05")
    assert code == 0
    assert "12 logs with 3 added masses" in out
    assert "best p4" in out


def test_a_folder_without_manifest_needs_an_arm_and_then_works(butterfly, quick, tmp_path):
    butterfly("simulate", quick, "--out", tmp_path / "logs")
    folder = tmp_path / "named"
    folder.mkdir()
    entries = yaml.safe_load((tmp_path / "logs/manifest.yaml").read_text())["logs"]
    for entry in entries:
        grams, omega = f"{1e3 * entry['added_mass']:g}", f"{entry['omega']:g}".replace(".", "_")
        digits = f"{entry['amplitude']:g}".replace(".", "")
        (tmp_path / "logs" / entry["file"]).rename(folder / f"Data_{grams}__{omega}__{digits}.mat")
    _assert_one_line_error(butterfly("identify", folder), folder, "manifest.yaml", "--arm")
    assert butterfly("identify", folder, "--arm", 0.104)[0] == 0
    assert butterfly("manifest", folder, "--arm", 0.104)[0] == 0
    assert butterfly("identify", folder)[0] == 0


def test_inspect_shows_health_and_draws(butterfly, log_file, tmp_path):
    code, out, _ = butterfly("inspect", log_file, "--plot", tmp_path / "plot.html")
    assert code == 0
    assert "dominant frequency" in out
    assert "40000" in out
    assert (tmp_path / "plot.html").stat().st_size > 1e6


def test_inspect_repairs_what_it_is_told_to(butterfly, log_file):
    matrix = loadmat(log_file)["D"]
    matrix[5, 2] = np.nan
    savemat(log_file, {"D": matrix})
    _assert_one_line_error(butterfly("inspect", log_file), log_file, "angle", "sample 5")
    code, out, _ = butterfly("inspect", log_file, "--repair", "non_finite")
    assert code == 0
    assert "1 × sample not finite" in out


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (lambda d: d[:, :2], ("D", "shape (40000, 2)")),
        (lambda d: d[::-1], ("time", "ascending")),
        (lambda d: d * [0, 1, 1, 1] + [2, 0, 0, 0], ("time", "never advances")),
        (lambda d: d * [1, 1, 0, 1], ("angle", "constant 0")),
        (lambda d: d[:4], ("time", "4 samples")),
    ],
    ids=["shape", "unsorted", "stopped clock", "no motion", "too short"],
)
def test_a_bad_log_is_one_line_with_file_field_value_and_exit_code_2(
    butterfly, log_file, change, parts
):
    savemat(log_file, {"D": change(loadmat(log_file)["D"])})
    _assert_one_line_error(butterfly("inspect", log_file), log_file, *parts)


@pytest.mark.parametrize(
    "arguments",
    [
        ("identify", "nowhere"),
        ("run", "nowhere.yaml"),
        ("simulate", "nowhere.yaml", "--out", "x"),
        ("inspect", "nowhere.mat"),
        ("inspect", "notes.txt"),
        ("manifest", "nowhere", "--arm", "0.1"),
    ],
)
def test_a_missing_file_is_one_line_and_exit_code_2(butterfly, arguments):
    _assert_one_line_error(butterfly(*arguments), arguments[1])


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("p1=0.1,p2=0.1", "p3"),
        ("p1=x,p2=1,p3=1", "got x"),
        ("p1", "NAME=VALUE"),
        ("p1=1,p2=1,p3=1,mass=2", "unknown parameter"),
    ],
)
def test_a_slip_in_against_is_named(butterfly, quick_data, text, part):
    _assert_one_line_error(butterfly("identify", quick_data, "--against", text), part)


def test_one_added_mass_alone_is_refused_in_one_line(butterfly, quick, tmp_path):
    content = yaml.safe_load(quick.read_text())
    content["added_masses"] = content["added_masses"][1:2]
    quick.write_text(yaml.safe_dump(content))
    result = butterfly("run", quick, "--out", tmp_path / "out")
    _assert_one_line_error(result, "common factor", "add a run")


def test_a_report_that_cannot_be_written_is_one_line(butterfly, quick, tmp_path):
    (tmp_path / "file").touch()
    result = butterfly("simulate", quick, "--out", tmp_path / "file")
    _assert_one_line_error(result, tmp_path / "file")


def test_the_real_logs_are_identified_from_the_shipped_manifest(butterfly, logs_folder):
    code, out, _ = butterfly("identify", "real-logs", "--root", logs_folder)
    assert code == 0
    assert "41 logs with 3 added masses" in out
    assert "2.473" in out


def test_the_model_of_an_experiment_is_shown_and_exported(butterfly, tmp_path):
    code, out, _ = butterfly("model", "show", "quickstart", "--added-mass", 0.05)
    assert code == 0
    assert "5.1306 rad/s" in out
    assert butterfly("model", "export", "quickstart", "--out", tmp_path / "q.xml")[0] == 0
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "q.xml"))
    assert model.dof_damping[0] == 2e-4


def test_the_twin_of_a_data_set_is_exported_and_moves_as_identified(
    butterfly, quick_data, tmp_path
):
    assert butterfly("model", "export", quick_data, "--out", tmp_path / "t.xml")[0] == 0
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "t.xml"))
    data = mujoco.MjData(model)
    data.qpos[0], data.ctrl[0] = 0.5, 1.0
    mujoco.mj_forward(model, data)
    inertia = np.zeros((1, 1))
    mujoco.mj_fullM(model, data, inertia)
    assert inertia[0, 0] == pytest.approx(0.00325, rel=0.02)
    assert data.qfrc_bias[0] == pytest.approx(0.04905 * np.sin(0.5), rel=0.02)
    assert data.qfrc_actuator[0] == pytest.approx(0.025, rel=0.02)


def test_what_is_neither_experiment_nor_data_set_is_refused(butterfly, tmp_path):
    path = tmp_path / "other.yaml"
    path.write_text("colour: blue")
    _assert_one_line_error(butterfly("model", "show", path), path, "colour")


def test_a_run_that_does_not_exist_cannot_be_filmed(butterfly, tmp_path):
    result = butterfly("video", "quickstart", "--run", 24, "--out", tmp_path / "x.gif")
    _assert_one_line_error(result, "--run", "got 24", "from 0 to 23")


def test_a_sine_that_will_swing_wide_is_warned_about(butterfly, quick, tmp_path):
    content = yaml.safe_load(quick.read_text())
    content.update(duration=0.1, excitations=[{"omega": 3.9, "amplitude": 0.9}])
    quick.write_text(yaml.safe_dump(content))
    code, _, err = butterfly("simulate", quick, "--out", tmp_path / "logs")
    assert code == 0
    assert "warning: 0 g at 104 mm, 3.9 rad/s: predicted to swing" in err
