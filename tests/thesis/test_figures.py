"""Figures 3 to 12: their data, what they are said to show, and how they are written."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.cli.commands import reproduce, thesis_robot
from butterfly.thesis.figures import real_figures, synthetic_figures
from butterfly.thesis.tables import TABLE_4_PRINTED


def test_the_synthetic_figures_agree_but_for_the_peaks_that_leakage_makes(synthetic):
    assert list(synthetic) == [f"figure_{k:02d}" for k in range(3, 9)]
    failing = [c.text for figure in synthetic.values() for c in figure.claims if not c.holds]
    assert len(failing) == 1
    assert "other peaks" in failing[0]
    spectrum, gains = (synthetic[name].columns for name in ("figure_06", "figure_08"))
    peak = spectrum["omega_rad_per_s"][np.argmax(spectrum["power_rad2"])]
    assert abs(peak - 4.0) < 0.1
    at = np.interp(4.0, gains["curve_omega_rad_per_s"], gains["linearisation_gain"])
    measured = gains["gain_without_noise"][gains["omega_rad_per_s"] == 4.0][0]
    assert abs(measured / at - 1) < 0.05


def test_another_robot_does_not_agree():
    robot = thesis_robot()
    louder = [replace(sine, amplitude=1e3 * sine.amplitude) for sine in robot.sines]
    swing = synthetic_figures(replace(robot, sines=louder))[0]
    assert [claim.holds for claim in swing.claims] == [False, False]
    assert swing.sentence.startswith("Does not agree: within ±10°")


def test_the_real_figures_have_the_resonances_of_table_4_and_not_the_gains(logs_folder):
    swing, stamps, spectrum, gains = real_figures(logs_folder)
    assert all(claim.holds for figure in (swing, stamps) for claim in figure.claims)
    assert [claim.holds for claim in spectrum.claims] == [True, False]
    assert [claim.holds for claim in gains.claims] == [True, False, False]
    assert list(gains.marks.values()) == [float(x) for x in TABLE_4_PRINTED.split()]
    assert "13.9" in gains.claims[1].text  # dB: a 25th of the samples
    assert np.median(stamps.columns["interval_ms"]) < 2
    assert sum(v.size for k, v in gains.columns.items() if k.startswith("omega")) == 41


@pytest.mark.slow
def test_the_command_draws_all_figures(logs_folder, tmp_path):
    reproduce("thesis", root=logs_folder, out=tmp_path)
    names = {path.stem for path in tmp_path.iterdir()}
    assert len(list(tmp_path.glob("*.svg"))) == 14
    assert names >= {"thesis", "figure_12", "resonance", "regression", "invariant_scale"}
