"""The commands that run experiments."""

import yaml

from butterfly.cli.output import ExitCode
from butterfly.identification.estimators import harmonic_balance_regression
from tests.cli.one_line import assert_one_line_error


def test_run_prints_true_and_estimated_parameters_and_writes_a_report(
    butterfly, quick_in_mujoco, tmp_path
):
    code, out, err = butterfly("run", quick_in_mujoco, "--out", tmp_path / "out")
    assert (code, err) == (0, "")
    assert "0.00325" in out
    assert "deviation" in out
    assert (tmp_path / "out/report.html").stat().st_size > 5e5


def test_one_added_mass_alone_is_refused_in_one_line(butterfly, quick, tmp_path):
    content = yaml.safe_load(quick.read_text())
    content["added_masses"] = content["added_masses"][1:2]
    quick.write_text(yaml.safe_dump(content))
    result = butterfly("run", quick, "--out", tmp_path / "out")
    assert_one_line_error(result, "common factor", "add a run")


def test_a_report_that_cannot_be_written_is_one_line(butterfly, quick, tmp_path):
    (tmp_path / "file").touch()
    result = butterfly("simulate", quick, "--out", tmp_path / "file")
    assert_one_line_error(result, tmp_path / "file")


def test_a_sine_that_will_swing_wide_is_warned_about(butterfly, quick, tmp_path):
    content = yaml.safe_load(quick.read_text())
    content.update(duration=0.1, excitations=[{"omega": 3.9, "amplitude": 0.9}])
    quick.write_text(yaml.safe_dump(content))
    code, _, err = butterfly("simulate", quick, "--out", tmp_path / "logs")
    assert code == 0
    assert "warning: no added mass, 3.9 rad/s: predicted to swing" in err


def test_a_run_whose_estimate_did_not_settle_ends_with_code_3_done_or_found_done(
    butterfly, quick, tmp_path, monkeypatch
):
    monkeypatch.setattr(harmonic_balance_regression, "_MAX_ITERATIONS", 1)
    for said in ("deviation", "found done"):
        code, out, err = butterfly("run", quick, "--out", tmp_path / "out")
        assert (code, err) == (ExitCode.NOT_TO_BE_USED, "")
        assert "did not settle" in out
        assert said in out
