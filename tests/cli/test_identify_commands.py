"""`butterfly identify`."""

import shutil

import pytest
import yaml

import butterfly as bf
from butterfly.cli.exit_codes import ExitCode
from butterfly.identification.estimators import harmonic_balance_regression
from butterfly.logs.manifest import read_manifest
from tests.cli.one_line import assert_one_line_error


def test_simulated_logs_are_identified_like_any_folder(butterfly, quick_in_mujoco, tmp_path):
    folder = tmp_path / "logs"
    assert butterfly("simulate", quick_in_mujoco, "--out", folder)[0] == 0
    code, out, _ = butterfly("identify", folder, "--against", "p1=0.004,p2=0.001,p3=0.05")
    assert code == 0
    assert "12 logs with 3 added masses" in out
    assert "best p4" in out


def test_a_folder_without_manifest_needs_an_arm_and_then_works(butterfly, quick_data, tmp_path):
    folder = tmp_path / "named"
    folder.mkdir()
    entries = yaml.safe_load((quick_data / "manifest.yaml").read_text())["logs"]
    for entry in entries:
        grams, omega = f"{1e3 * entry['added_mass']:g}", f"{entry['omega']:g}".replace(".", "_")
        digits = f"{entry['amplitude']:g}".replace(".", "")
        shutil.copy(quick_data / entry["file"], folder / f"Data_{grams}__{omega}__{digits}.mat")
    assert_one_line_error(butterfly("identify", folder), folder, "manifest.yaml", "--arm")
    assert butterfly("identify", folder, "--arm", 0.104)[0] == 0
    assert butterfly("manifest", folder, "--arm", 0.104)[0] == 0
    assert butterfly("identify", folder)[0] == 0


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
    assert_one_line_error(butterfly("identify", quick_data, "--against", text), part)


def test_the_real_logs_are_identified_from_the_shipped_manifest(butterfly, logs_folder):
    code, out, _ = butterfly("identify", "real-logs", "--root", logs_folder)
    assert code == 0
    assert "41 logs with 3 added masses" in out
    assert "2.47" in out


def test_a_robust_loss_can_be_asked_for(butterfly, quick_data):
    code, out, err = butterfly(
        "identify", quick_data, "--method", "output-error", "--loss", "soft_l1"
    )
    assert code == 0, err
    assert "converged" in out


def test_every_method_identifies_the_simulated_robot(butterfly, quick_data):
    for method in ("harmonic-balance", "output-error", "weak-form", "linear"):
        code, out, err = butterfly("identify", quick_data, "--method", method)
        assert code == 0, err
        assert method.replace("-", " ").split()[0] in out


def test_an_estimate_that_did_not_settle_is_printed_and_ends_with_code_3(
    butterfly, quick_data, monkeypatch, tmp_path
):
    monkeypatch.setattr(harmonic_balance_regression, "_MAX_ITERATIONS", 1)
    report = tmp_path / "report.html"
    code, out, err = butterfly("identify", quick_data, "--report", report)
    assert (code, err) == (ExitCode.NOT_TO_BE_USED, "")
    assert "95 % interval" in out
    assert "did not settle in 1 rounds: do not trust the values" in out
    assert report.exists()


def test_the_data_of_a_saved_result_are_data(butterfly, quick_data, tmp_path):
    saved = tmp_path / "saved.json"
    bf.identify(quick_data, check=False).save(saved)
    assert butterfly("identify", saved)[1] == butterfly("identify", quick_data)[1]


def test_one_log_is_data_of_which_the_estimator_says_what_is_missing(butterfly, quick_data):
    file = quick_data / read_manifest(quick_data / "manifest.yaml").logs[4].file
    assert_one_line_error(butterfly("identify", file), "same added mass")


def test_figures_without_a_report_are_refused(butterfly, quick):
    code, _, err = butterfly("identify", quick, "--figures")
    assert code == 2
    assert "--report FILE beside it" in err
