"""The figures of an identification are true to its numbers."""

import dataclasses

import numpy as np
import pytest

from butterfly.report.identification_figures import swings_between
from butterfly.signals.frequency_response import response_point


def test_the_lines_of_the_frequency_response_pass_through_the_simulated_logs(simulated):
    result, _ = simulated
    figure = result.plot.frequency_response()
    lines = [trace for trace in figure.data if trace.mode == "lines"]
    assert len(lines) == 2 * len(result.data.masses)
    for mass, gain, phase in zip(result.data.masses, lines[::2], lines[1::2], strict=True):
        for point, run in zip(result.data.points, result.free_runs, strict=True):
            if point is None or point.added_mass != mass:
                continue
            treated = dataclasses.replace(run.log, angle=run.simulated)
            expected = response_point(treated, pole=point.pole).gain
            (k,) = np.flatnonzero(gain.x == point.omega)
            assert gain.y[k] == pytest.approx(abs(expected), rel=1e-9)
            turned = np.exp(1j * np.radians(phase.y[k]))
            assert abs(turned - expected / abs(expected)) < 1e-9
        assert gain.x[0] == min(p.omega for p in result.data.sines if p.added_mass == mass)


def test_the_errors_of_a_right_model_s_response_are_those_of_the_measurement(simulated):
    figure = simulated[0].plot.frequency_response()
    errors = [trace for trace in figure.data if trace.mode == "markers" and trace.yaxis == "y3"]
    assert errors
    for trace in errors:
        assert np.all(np.abs(trace.y) < 2 * np.asarray(trace.error_y.array) + 0.1)


def _with_swing(point, amplitude):
    factor = amplitude / point.amplitude
    angle = dataclasses.replace(point.angle, phasors=factor * point.angle.phasors)
    return dataclasses.replace(point, angle=angle, input=factor * point.input)


def test_several_swings_at_one_frequency_count_as_their_geometric_mean(simulated):
    first = simulated[0].data.sines[0]
    pair = [_with_swing(first, 0.1), _with_swing(first, 0.4)]
    omega, swing = swings_between(pair)
    assert omega.tolist() == [first.omega]
    assert swing == pytest.approx([0.2])


def test_the_ranked_fits_are_all_logs_from_the_worst_to_the_best(simulated):
    result = simulated[0]
    points = [
        (row, fit, log)
        for trace in result.plot.fits().data
        for fit, row, log in zip(trace.x, trace.y, trace.customdata, strict=True)
    ]
    points.sort()
    assert [row for row, _, _ in points] == list(range(result.fit_of_logs.size))
    assert [fit for _, fit, _ in points] == sorted(result.fit_of_logs)
    assert all(result.fit_of_logs[log] == fit for _, fit, log in points)
    names = list(result.plot.fits().layout.yaxis.ticktext)
    assert names == [result.data.logs[log].label for _, _, log in points]


def test_labels_of_logs_are_no_markup_in_figures(simulated):
    result = simulated[0]
    logs = [
        dataclasses.replace(log, excitation=None, source="<b>x.csv") for log in result.data.logs
    ]
    data = dataclasses.replace(result.data, logs=tuple(logs))
    figure = dataclasses.replace(result, logs=data).plot.fits()
    texts = [text for trace in figure.data for text in trace.text]
    assert {text.partition(", ")[2] for text in texts} == {"&lt;b&gt;x.csv"}


def test_the_forest_plot_has_every_parameter(simulated):
    result, truth = simulated
    figure, rows = result.plot.parameters(), result.estimate.table(truth)
    (bars,) = [trace for trace in figure.data if trace.name == "95 % half-width"]
    assert (len(bars.x), figure.layout.xaxis.type) == (3 * len(rows), "log")
    assert list(figure.layout.yaxis.ticktext) == [row.name for row in rows]
    assert {trace.xaxis for trace in figure.data} == {None}  # one axis
    assert "may be 0" in [trace.name for trace in figure.data]  # of the delay
