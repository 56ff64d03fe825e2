"""Figures of a log are true to it, thinned or not, wherever its clock starts."""

import dataclasses
import json

import numpy as np
import pytest

from butterfly.report.log_figures import (
    correlation_figure,
    correlation_series,
    first_stretch,
    spectrum_figure,
    spectrum_series,
    time_figure,
    time_series,
)
from tests.report.setting import assert_seen, unpacked


@pytest.mark.parametrize("start", [0.0, 1.76e9, -1e6])
def test_a_time_plot_is_true_wherever_the_clock_starts(simulated, start):
    run = simulated[0].free_runs[0]
    log = dataclasses.replace(run.log, time=run.log.time + start)
    series = time_series([dataclasses.replace(run, log=log)], [None])
    time = unpacked(json.loads(json.dumps(series.curves[0][0][0])))
    assert np.ptp(time) == pytest.approx(np.ptp(log.time), rel=1e-3)
    assert np.diff(time).max() < 0.1
    drawn = time_figure(dataclasses.replace(run, log=log), None).data[0].x
    np.testing.assert_allclose(np.diff(drawn), np.diff(drawn - start), atol=1e-6)
    assert np.diff(drawn).max() < 0.1


def test_a_page_s_curves_are_the_points_of_each_log_s_own_figure(simulated):
    runs, logs = simulated[0].free_runs, simulated[0].residuals.logs
    bands = [log.band for log in logs]
    pairs = list(zip(runs, logs, strict=True))
    for series, figures in (
        (time_series(runs, bands), [time_figure(run, log.band) for run, log in pairs]),
        (correlation_series(logs), [correlation_figure(log) for log in logs]),
        (spectrum_series(runs, logs), [spectrum_figure(*pair) for pair in pairs]),
    ):
        shown = json.loads(json.dumps(vars(series)))
        for panels, figure in zip(shown["curves"], figures, strict=True):
            points = [(panel[0], y) for panel in panels for y in panel[1:]]
            assert [each.get("name") for each in shown["data"]] == [t.name for t in figure.data]
            for packed, trace in zip(points, figure.data, strict=True):
                for each, drawn in zip(packed, (trace.x, trace.y), strict=True):
                    logarithmic = each.get("logarithmic", False)
                    assert_seen(unpacked(each), np.log10(drawn) if logarithmic else drawn)


def test_noise_in_a_spectrum_is_as_high_as_its_peaks(simulated):
    rng, ratios = np.random.default_rng(0), []
    for run, residuals in zip(
        simulated[0].free_runs[:3], simulated[0].residuals.logs, strict=False
    ):
        noise = rng.normal(0, residuals.sensor.spread, run.log.time.size)
        even = np.linspace(run.log.time[0], run.log.time[-1], run.log.time.size)
        log = dataclasses.replace(run.log, time=even)
        noisy = dataclasses.replace(run, log=log, simulated=log.measured - noise)
        _, found, expected = spectrum_figure(noisy, residuals).data
        slow = found.x < 0.1 * np.pi / log.mean_step  # beyond, interpolation smooths noise
        ratios.extend((found.y[slow] / expected.y[slow]) ** 2)
    assert len(ratios) > 200
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.15)


def test_what_was_measured_is_drawn_above_what_was_simulated_and_thinner(simulated):
    run = simulated[0].free_runs[0]
    traces = [trace for trace in time_figure(run, None).data if trace.yaxis == "y"]
    assert [trace.name for trace in traces] == ["simulated", "measured"]
    assert traces[0].line.width > 2 * traces[1].line.width


def test_the_last_five_periods_of_a_sine_are_seen_first_and_the_whole_log_is_there(simulated, page):
    runs = simulated[0].free_runs
    series = time_series(runs, [None] * len(runs))
    for run, stretch in zip(runs, series.stretches, strict=True):
        first, last, periods = run.log.time[0], run.log.time[-1], 10 * np.pi
        seen = periods / run.log.excitation.omega
        shorter = last - first <= seen
        assert stretch is None if shorter else stretch == pytest.approx((last - seen, last))
    assert any(series.stretches)
    first = unpacked(series.curves[0][0][0])
    assert first[0] == pytest.approx(runs[0].log.time[0], abs=1e-3)
    assert 'class="whole"' in page.read_text(encoding="utf-8")
    free = dataclasses.replace(runs[0].log, excitation=None)
    assert first_stretch(free) is None
