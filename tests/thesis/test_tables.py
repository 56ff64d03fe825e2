from dataclasses import replace

import numpy as np
import pytest

from butterfly.cli.commands import thesis_robot
from butterfly.logs import thesis_logs
from butterfly.logs.log import Sine
from butterfly.model.parameters import AddedMass
from butterfly.plant.sensors import Clock
from butterfly.thesis.tables import reproduce, scripted_point, scripted_resonance, synthetic_log


@pytest.mark.slow
def test_every_published_digit_is_obtained_but_table_5_s(logs_folder):
    rows = {row.what.split(":")[0]: row for row in reproduce(thesis_robot(), logs_folder)}
    table_5 = rows.pop("Table 5, p1 p2 p3")
    assert all(row.agrees for row in rows.values())
    assert len(rows) == 7
    assert table_5.obtained == "0.0029 0.0200 0.0652"  # the errata's bounded minimum
    assert rows["Table 1, column 3"].corrected == "3.8788 3.9741 4.2436 4.6489 5.1447"
    right = np.array(rows["Table 1, column 4"].corrected.split(), float)
    exact = np.array(rows["Table 1, column 3"].corrected.split(), float)
    assert np.abs(right - exact).max() < 1e-3
    linearised = np.array(rows["Table 4"].corrected.split(), float)
    np.testing.assert_allclose(linearised, [4.50, 6.02, 6.46], rtol=0.015)


def test_without_simulink_s_noise_table_1_has_the_digits_of_the_errata():
    robot = thesis_robot()
    found = []
    for added in robot.added_masses[:2]:
        logs = [synthetic_log(robot, added, s, noise=False) for s in robot.sines]
        found.append(f"{scripted_resonance([scripted_point(log) for log in logs]):.4f}")
    assert found == ["3.7739", "3.7704"]


def test_a_synthetic_log_lasts_as_long_as_the_experiment_says_whatever_its_clock():
    robot = thesis_robot()
    fast = replace(robot.rig, clock=Clock(step=0.004))
    changed = replace(robot, rig=fast, duration=2.0)
    log = synthetic_log(changed, AddedMass(), Sine(omega=3.0, amplitude=1e-4), noise=False)
    assert log.time[-1] == pytest.approx(2.0)
    np.testing.assert_allclose(np.diff(log.time), 0.004, rtol=1e-9)


@pytest.mark.slow
def test_the_synthetic_tables_need_no_real_logs(monkeypatch, tmp_path):
    monkeypatch.delenv("BUTTERFLY_LOGS", raising=False)
    monkeypatch.setattr(thesis_logs, "own_folder", lambda: tmp_path)
    assert [row.what for row in reproduce(thesis_robot())][-1].startswith("Table 2")
