"""The page of an identification and its figures: whole, offline, and true to the numbers."""

import dataclasses
import html
import json
import re

import numpy as np
import pytest

from butterfly.api.verbs import identify
from butterfly.experiment.source import read_experiment
from butterfly.identification.data import read_data_set
from butterfly.identification.estimators import Linear
from butterfly.identification.parameter import Parameter
from butterfly.identification.test_functions import ResidualTorque
from butterfly.logs.health import examine
from butterfly.logs.manifest import read_manifest
from butterfly.model.linear import quasi_linear_response
from butterfly.report.figures import grams, mass_looks, seen_samples
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.forest import forest
from butterfly.report.identification_figures import swings_between
from butterfly.report.inspection import health_rows
from butterfly.report.log_figures import (
    correlation_figure,
    correlation_series,
    first_stretch,
    spectrum_figure,
    spectrum_series,
    time_figure,
    time_series,
)
from butterfly.report.page import packable
from butterfly.report.parameter_table import parameter_texts
from butterfly.report.residual import residual_sentences, residual_table, torque_figure
from butterfly.report.summary import summary


@pytest.fixture(scope="module")
def simulated(quick_data):
    truth = read_experiment("quickstart").plant.robot.lumped
    found = identify(read_data_set(read_manifest(quick_data / "manifest.yaml")))
    return dataclasses.replace(found, truth=truth), truth


@pytest.fixture(scope="module")
def told(simulated):
    """The page, before it is written."""
    return simulated[0].page()


@pytest.fixture(scope="module")
def page(simulated, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    simulated[0].report(path)
    return path


def test_the_page_holds_every_parameter_log_and_sentence_and_asks_nothing_of_the_network(
    page, simulated
):
    text = html.unescape(page.read_text(encoding="utf-8"))
    markup = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", markup)
    assert "@import" not in markup
    result, truth = simulated
    for row in map(parameter_texts, result.estimate.table(truth)):
        for key in ("name", "meaning", "value", "error", "interval", "true", "deviation"):
            assert row[key] in text
    said = estimate_verdict(result.estimate)
    assert f'<div class="verdict {said.level}">' in text
    for sentence in (*said.reasons, *summary(result)[2:], *residual_sentences(result.residuals)):
        assert sentence in text
    assert text.count('<tr class="pick"') == 2 * len(result.data.logs) == 18
    cells = [cell for row in residual_table(result.residuals.logs, []).rows for cell in row]
    assert all(cell in text for cell in cells)


def test_the_numbers_beside_the_page_say_what_is_left_over(page, simulated):
    residuals = simulated[0].residuals
    numbers = json.loads(page.with_suffix(".json").read_text(encoding="utf-8"))
    assert numbers["residuals"]["times_sensors"] == pytest.approx(residuals.times)
    assert numbers["residuals"]["findings"][0]["kind"] == "followed"


def _numbers(curve):
    """As the page's script unpacks a curve."""
    steps = [0 if step is None else step for step in curve["steps"]]
    numbers = curve["begin"] + curve["quantum"] * np.cumsum(steps)
    return np.where([step is None for step in curve["steps"]], np.nan, numbers)


def _assert_seen(found, expected):
    """Check that no eye sees a difference: a line is wider."""
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    there = np.asarray(expected)[np.isfinite(expected)]
    reach = np.ptp(there) if there.size else 0.0
    np.testing.assert_allclose(found, expected, atol=1e-4 * reach, rtol=1e-12)


def test_what_is_no_number_is_packed_as_none():
    for values in ([0.5, np.nan, -0.25, np.inf], [np.nan], [], [0.0, 0.0]):
        array = np.array(values, dtype=np.float32)
        packed = json.loads(json.dumps(packable(array)))
        _assert_seen(_numbers(packed), np.where(np.isfinite(array), array, np.nan))


@pytest.mark.parametrize("start", [0.0, 1.76e9, -1e6])
def test_a_time_plot_is_true_wherever_the_clock_starts(simulated, start):
    run = simulated[0].free_runs[0]
    log = dataclasses.replace(run.log, time=run.log.time + start)
    series = time_series([dataclasses.replace(run, log=log)], [None])
    time = _numbers(json.loads(json.dumps(series.curves[0][0][0])))
    assert np.ptp(time) == pytest.approx(np.ptp(log.time), rel=1e-3)
    assert np.diff(time).max() < 0.1
    drawn = time_figure(dataclasses.replace(run, log=log), None).data[0].x
    np.testing.assert_allclose(np.diff(drawn), np.diff(drawn - start), atol=1e-6)
    assert np.diff(drawn).max() < 0.1


def test_beside_other_parameters_a_method_without_coulomb_torque_has_a_dash_for_it(
    simulated, tmp_path
):
    result, truth = simulated
    linear = identify(result.data.take([0, 2, 3, 5]), Linear(), against={"truth": truth})
    linear.report(tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text(encoding="utf-8")
    row = re.search(r"<tr>\s*<td>this identification</td>(.*?)</tr>", text, re.DOTALL)[1]
    cells = re.findall(r"<td>(.*?)</td>", row)
    assert cells[4] == "–"
    assert cells[5:] == [f"{v:.1f}" for v in (linear.fit.median, linear.fit.mean, linear.fit.worst)]


def test_the_lines_of_the_frequency_response_are_the_model_at_the_measured_swing(simulated):
    result, _ = simulated
    figure = result.plot.frequency_response()
    lines = [trace for trace in figure.data if trace.mode == "lines"]
    assert len(lines) == 2 * len(result.data.masses)
    for mass, gain, phase in zip(result.data.masses, lines[::2], lines[1::2], strict=True):
        loaded = result.estimate.parameters.with_added_mass(mass)
        for point in (p for p in result.data.sines if p.added_mass == mass):
            expected = quasi_linear_response(loaded, point.omega, point.amplitude)
            (k,) = np.flatnonzero(gain.x == point.omega)
            assert gain.y[k] == pytest.approx(abs(expected), rel=1e-9)
            turned = np.exp(1j * np.radians(phase.y[k]))
            assert abs(turned - expected / abs(expected)) < 1e-9
        assert gain.x[0] == min(p.omega for p in result.data.sines if p.added_mass == mass)


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
                    _assert_seen(_numbers(each), np.log10(drawn) if logarithmic else drawn)


def test_a_long_curve_keeps_its_peaks_when_it_is_thinned():
    rng = np.random.default_rng(0)
    curves = [rng.normal(size=100_000), np.cumsum(rng.normal(size=100_000))]
    some = seen_samples(curves, 1000)
    assert some.size <= 1002
    assert np.all(np.diff(some) > 0)
    for curve in curves:
        assert curve[some].max() == curve.max()
        assert curve[some].min() == curve.min()
    assert seen_samples(curves, 1000, every=200).tolist() == list(range(0, 100_000, 200))


def _row(**numbers):
    """A parameter of a table."""
    about = {"name": "p2", "meaning": "friction", "unit": "N m s/rad", "standard_error": 0.1}
    return Parameter(**about | numbers)


def test_all_half_widths_are_on_one_logarithmic_axis_in_per_cent_of_their_values():
    sure = _row(value=2.0, lower=1.9998, upper=2.0004, true=2.0001)
    wide = _row(value=1.0, lower=0.7, upper=1.2, least_left_out=0.9, largest_left_out=1.0)
    idle = _row(value=0.1, lower=-0.3, upper=0.5)
    rows = forest([sure, wide, idle, _row(value=1.0, lower=1.0, upper=1.0, known=True)])
    (axis,) = {each.axis for each in rows}
    assert axis.decades == [0.01, 0.1, 1.0, 10.0, 100.0]
    assert (rows[0].half_width, rows[0].true) == pytest.approx((0.02, 0.005))
    assert rows[1].left_out == pytest.approx(10.0)
    assert [each.may_be_zero for each in rows] == [False, False, True, False]
    places = [axis.place(each.half_width) for each in rows[:3]]
    assert places == pytest.approx([7.5, 86.9, 100.0], abs=0.1)  # each is seen
    assert axis.place(rows[0].true) == 0.0  # at the edge
    unknown = [_row(value=value, lower=-np.inf, upper=1.0) for value in (0.0, np.nan)]
    assert {each.half_width for each in (rows[3], *forest(unknown))} == {None}
    assert forest([_row(value=0.0, lower=-1.0, upper=1.0)])[0].axis.decades == [10.0, 100.0]


def test_a_badge_says_how_well_a_parameter_is_known():
    plain = {"value": 1.0, "lower": 0.95, "upper": 1.05, "claim": "rough"}
    for badge, about in {
        "good": {"upper": 1.09},
        "care": {"upper": 1.2},
        "poor": {"upper": 1.5},
        "may be 0": {"lower": -0.1, "claim": "not-from-zero"},
        "at bound": {"on_bound": True},
        "known": {"known": True},
        "": {"lower": None, "claim": ""},
    }.items():
        assert parameter_texts(_row(**plain | about))["mark"] == badge
    assert parameter_texts(_row(value=0.0, lower=0.0, upper=0.2))["width"] == "may be 0"


def test_the_first_screen_says_verdict_fit_and_every_parameter_with_its_interval_and_truth(
    simulated, told
):
    result, truth = simulated
    assert told.headed.text == "Good"
    assert f"{result.fit.median:.1f} %" in [fact.value for fact in told.facts]
    (table,) = told.lead.tables
    assert [str(row[0]) for row in table.rows] == [row.name for row in result.estimate.table()]
    assert {row[4].axis for row in table.rows} == {table.headers[4]}
    for row, each in zip(table.rows, result.estimate.table(truth), strict=True):
        if each.true:
            assert row[4].true == pytest.approx(100 * abs(each.true / each.value - 1))
        if each.value:
            assert row[4].half_width == pytest.approx(100 * each.farther / abs(each.value))


def test_the_first_screen_repeats_the_numbers_of_its_verdict(told):
    values, model = told.headed.reasons
    widths = {str(row[0]): row[5] for row in told.lead.tables[0].rows}
    assert widths.pop("delay") == "may be 0"
    for name, width in widths.items():
        assert f"{name} {width.replace(' ', '', 1)}" in values
    (error,) = [fact.value for fact in told.facts if fact.label == "model error"]
    assert f"error {error} of the motion" in model


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


def test_the_map_is_the_correlation_of_the_estimate_s_errors(simulated):
    result = simulated[0]
    estimate = result.estimate
    shown = np.array(result.plot.correlations().data[0].z)[::-1]
    np.testing.assert_allclose(np.diag(shown), 1.0)
    expected = estimate.covariance[0, 2] / np.sqrt(
        estimate.covariance[0, 0] * estimate.covariance[2, 2]
    )
    assert shown[0, 2] == pytest.approx(expected)
    unknown = dataclasses.replace(estimate, covariance=np.full_like(estimate.covariance, np.nan))
    assert dataclasses.replace(result, estimate=unknown).plot.correlations() is None


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


def test_logs_from_which_the_model_runs_away_are_told_and_not_drawn(simulated, told):
    result = simulated[0]
    ends = {1: np.inf, 2: 1e300, 4: np.nan}
    runs = [
        dataclasses.replace(run, simulated=np.where(run.log.time > 6, ends[k], run.simulated))
        if k in ends
        else run
        for k, run in enumerate(result.free_runs)
    ]
    away = dataclasses.replace(result, runs=tuple(runs)).page()
    section, whole = (
        next(each for each in page.sections if each.title == "FIT log by log")
        for page in (away, told)
    )
    assert "Not drawn: 3 logs from which the model diverges." in section.text
    assert "Not drawn" not in whole.text


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
    first = _numbers(series.curves[0][0][0])
    assert first[0] == pytest.approx(runs[0].log.time[0], abs=1e-3)
    assert 'class="whole"' in page.read_text(encoding="utf-8")
    free = dataclasses.replace(runs[0].log, excitation=None)
    assert first_stretch(free) is None


def test_one_added_mass_has_one_colour_in_all_figures_of_a_page(simulated):
    result = simulated[0]
    looks = mass_looks(reversed(result.data.masses))
    for figure in (result.plot.fits(), result.plot.frequency_response()):
        for mass, (colour, _) in looks.items():
            own = [t for t in figure.data if (t.name or "").split(",")[0] == grams(mass)]
            assert {t.line.color or t.marker.color for t in own} == {colour}


def test_a_footer_says_what_was_run_on_which_data_when_and_with_what(simulated, page, monkeypatch):
    text = html.unescape(page.read_text(encoding="utf-8"))
    footer = text[text.index("<footer>") :]
    for said in ("made from Python", "quickstart", "output-error", "<dt>date</dt>", "numpy "):
        assert said in footer
    monkeypatch.setattr("sys.argv", ["/bin/butterfly", "identify", "my logs", "-r", "x.html"])
    origin = simulated[0].page().origin
    assert origin["command"] == "butterfly identify 'my logs' -r x.html"
    assert list(origin) == ["command", "folder", "data", "options", "date", "versions"]


def test_health_rows_find_the_frequency_and_the_swing(sine_log):
    clean, health = examine(sine_log)
    rows = dict(health_rows(clean, health))
    assert float(rows["dominant frequency"].split()[0]) == pytest.approx(5, abs=0.1)
    assert float(rows["amplitude"].split()[0]) == pytest.approx(0.1, rel=1e-2)
    assert health.findings == []


def test_times_of_a_residual_are_true_wherever_the_clock_starts(simulated):
    result, _ = simulated
    setting = result.data.simulations.setting(0, result.estimate)
    torque = ResidualTorque.of(result.data.logs[0], setting.parameters, setting.zero)
    late = dataclasses.replace(torque, time=torque.time + 1.7e9)
    drawn = np.asarray(torque_figure(late, result.data.joint).data[0].x)
    assert np.all(np.isin(drawn, late.time))
