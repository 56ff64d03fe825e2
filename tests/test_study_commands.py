import re

import pytest


@pytest.fixture
def data(butterfly, quick, tmp_path):
    """A small simulated data set."""
    assert butterfly("simulate", quick, "--out", tmp_path / "data")[0] == 0
    return tmp_path / "data"


def test_unseen_masses_and_frequencies_are_predicted(butterfly, data):
    for split in ("mass", "frequency"):
        code, out, err = butterfly("validate", data, "--split", split)
        assert code == 0, err
        assert f"one {split} left out" in out
        assert "above 90 %" in out


def test_a_weighed_hand_and_the_bootstrap(butterfly, data):
    code, out, err = butterfly("identify", data, "--hand-mass", 0.1)
    assert code == 0, err
    assert "centre of mass" in out
    distance = float(re.search(r"centre of mass\s+([\d.]+) ±", out).group(1))
    assert distance == pytest.approx(0.05, rel=0.05)
    assert "weigh the hand" in out
    code, out, err = butterfly("validate", data, "--bootstrap", 20)
    assert code == 0, err
    assert "bootstrap over logs" in out


def test_terms_are_chosen(butterfly, data):
    code, out, err = butterfly(
        "select", data, "--method", "harmonic-balance", "--candidates", "drag,load"
    )
    assert code == 0, err
    assert "Chosen: --terms" in out


def test_a_term_that_is_none_is_one_line(butterfly, data):
    code, _, err = butterfly("validate", data, "--terms", "drug")
    assert code == 2
    assert "did you mean" in err
    assert err.count("\n") == 1


def test_the_residual_torque_is_named_and_drawn(butterfly, data, tmp_path):
    plot = tmp_path / "residual.html"
    code, out, _ = butterfly("residual", data, "--log", 2, "--plot", plot)
    assert code == 0
    assert "looks like" in out
    assert "velocity in rad" in plot.read_text(encoding="utf-8")
    code, _, err = butterfly("residual", data, "--log", 99)
    assert code == 2
    assert "less than 12" in err


def test_next_experiments_are_ranked(butterfly, data):
    code, out, err = butterfly("design", data, "--count", 3)
    assert code == 0, err
    assert "rad/s" in out or "free decay" in out


def test_the_thesis_is_reproduced(butterfly, logs_folder, tmp_path):
    code, out, _ = butterfly("reproduce", "thesis", "--root", logs_folder, "--out", tmp_path)
    assert code == 0
    assert "3.7740" in out
    assert (tmp_path / "figure_12.csv").exists()
    code, _, err = butterfly("reproduce", "everything")
    assert code == 2
    assert "thesis" in err


def test_a_robust_loss_can_be_asked_for(butterfly, data):
    code, out, err = butterfly("identify", data, "--method", "output-error", "--loss", "soft_l1")
    assert code == 0, err
    assert "converged" in out


def test_every_method_identifies_the_simulated_robot(butterfly, data):
    for method in ("harmonic-balance", "output-error", "weak-form", "linear"):
        code, out, err = butterfly("identify", data, "--method", method)
        assert code == 0, err
        assert method.replace("-", " ").split()[0] in out
