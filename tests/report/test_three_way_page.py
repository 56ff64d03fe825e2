"""Courses of logs beside both simulators."""

import numpy as np
import pytest

import butterfly as bf

LOGS = [1, 4, 8]


@pytest.fixture(scope="module")
def compared(result):
    return bf.compare(result, logs=LOGS)


def _drawn(compared, name):
    """The picture of the log that is seen first: its curves by their names."""
    return [(curve.name, curve) for curve in compared.page().pictures[name]().data]


def test_the_log_of_the_middle_fit_is_seen_first(compared):
    fits = [row["FIT grey box in %"] for row in compared.rows()]
    page = compared.page()
    assert fits[page.chosen] == np.median(fits)
    assert [label.split("FIT ")[1] for label in page.logs] == [f"{fit:.1f} %" for fit in fits]


def test_the_error_of_a_simulator_is_its_angle_less_the_measured_one(compared):
    curves = _drawn(compared, "time")
    measured = dict(curves)["measured"].y
    for name in ("MuJoCo", "grey box"):
        angle, error = (curve.y for each, curve in curves if each == name)
        np.testing.assert_allclose(angle - measured, error, atol=1e-6)
        assert 0 < np.abs(error).max() < 0.1 * np.ptp(measured)


def test_the_phase_plane_of_a_sine_is_an_ellipse_as_high_as_its_frequency(compared, result):
    log = result.data.logs[LOGS[compared.page().chosen]]
    curves = _drawn(compared, "phase")
    assert [name for name, _ in curves] == ["MuJoCo", "grey box", "measured"]
    for _, curve in curves:
        ratio = np.ptp(curve.y) / np.ptp(curve.x)
        assert ratio == pytest.approx(log.excitation.omega, rel=0.1)
