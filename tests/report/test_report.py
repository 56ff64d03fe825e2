"""The reports are whole, offline and drawn; a browser looks at them where there is one."""

import dataclasses
import html
import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from butterfly.experiment.perform import perform
from butterfly.experiment.reading import read_experiment
from butterfly.identify.estimators import Linear
from butterfly.identify.identification import identify
from butterfly.logs.health import examine
from butterfly.model.control_bridge import linearised
from butterfly.plant.joints import Simulator
from butterfly.report.figures import (
    frequency_response_figure,
    packable,
    time_figure,
    time_figures,
)
from butterfly.report.format import interval, with_error
from butterfly.report.identification import write_report
from butterfly.report.inspection import health_rows, write_inspection
from butterfly.report.misfit import (
    correlation_figure,
    correlation_figures,
    misfit_sentences,
    misfit_table,
)
from butterfly.report.parameter_rows import parameter_rows
from butterfly.report.words import summary, verdict_on
from butterfly.resources import shipped

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-extensions "
    "--disable-background-networking --disable-component-update --disable-sync "
    "--virtual-time-budget=10000 --enable-logging=stderr --dump-dom"
)


@pytest.fixture(scope="module")
def simulated():
    experiment = read_experiment(shipped("experiments/quickstart.yaml"))
    changes = {
        "duration": 12.0,
        "excitations": experiment.excitations[::2],
        "plant": experiment.plant.model_copy(update={"simulator": Simulator.GREY_BOX}),
    }
    brief = experiment.model_copy(update=changes)
    (result,) = perform(brief).identifications.values()
    return result, experiment.plant.robot.lumped


@pytest.fixture(scope="module")
def page(simulated, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    result, truth = simulated
    write_report(result, path, truth)
    return path


def test_the_page_asks_nothing_of_the_network(page):
    markup = re.sub(r"<script>.*?</script>", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", markup)
    assert "@import" not in markup


def test_the_page_holds_every_parameter_log_and_sentence(page, simulated):
    text = html.unescape(page.read_text(encoding="utf-8"))
    result, truth = simulated
    for row in parameter_rows(result, truth):
        for cell in (row.symbol, row.value, row.error, row.interval, row.true, row.deviation):
            assert cell in text
    said = verdict_on(result.estimate)
    assert f'<div class="verdict {str(said.standing).replace(" ", "-")}">' in text
    for sentence in (*said.paragraphs, *summary(result)[1:]):
        assert sentence in text
    assert text.count('<tr class="pick"') == 2 * len(result.data.logs) == 24
    for row in misfit_table(result.misfit.logs).rows:
        for cell in row:
            assert cell in text
    for sentence in misfit_sentences(result.misfit):
        assert sentence in text


def test_the_numbers_beside_the_page_say_what_is_left_over(page, simulated):
    misfit = simulated[0].misfit
    numbers = json.loads(page.with_suffix(".json").read_text(encoding="utf-8"))
    assert numbers["misfit"]["times_sensors"] == pytest.approx(misfit.times)
    assert [each["log"] for each in numbers["misfit"]["logs"]] == [log.name for log in misfit.logs]
    kinds = [each["kind"] for each in numbers["findings"]]
    assert {"misfit", "no-misfit"} & set(kinds)


def _numbers(curve):
    """As the page's script unpacks a curve."""
    steps = [0 if step is None else step for step in curve["steps"]]
    numbers = curve["quantum"] * np.cumsum(steps)
    return np.where([step is None for step in curve["steps"]], np.nan, numbers)


def _assert_seen(found, expected):
    """Check that no eye sees a difference: a line is wider."""
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    largest = np.nanmax(np.abs(expected), initial=0.0)
    np.testing.assert_allclose(found, expected, atol=1e-4 * largest, rtol=0)


def test_what_is_no_number_is_packed_as_none():
    for values in ([0.5, np.nan, -0.25, np.inf], [np.nan], [], [0.0, 0.0]):
        array = np.array(values, dtype=np.float32)
        packed = json.loads(json.dumps(packable(array)))
        _assert_seen(_numbers(packed), np.where(np.isfinite(array), array, np.nan))


def test_a_page_s_correlations_are_those_of_each_log_s_own_figure(simulated):
    misfit = simulated[0].misfit
    shown = json.loads(json.dumps(correlation_figures(misfit)))
    for log, panels in zip(misfit.logs, shown["curves"], strict=True):
        flat = [[_numbers(each) for each in panel] for panel in panels]
        drawn = correlation_figure(log).data
        ys = [y for _, *lines in flat for y in lines]
        assert len(ys) == len(drawn) == len(shown["data"])
        for y, trace in zip(ys, drawn, strict=True):
            _assert_seen(y, trace.y)


def test_a_name_with_markup_is_shown_and_not_obeyed(simulated, tmp_path):
    result, _ = simulated
    data = dataclasses.replace(result.data, name="<script>alert(1)</script>")
    hostile = dataclasses.replace(result, data=data)
    write_report(hostile, tmp_path / "r.html")
    assert "<script>alert(1)</script>" not in (tmp_path / "r.html").read_text(encoding="utf-8")


def test_beside_other_parameters_a_method_without_coulomb_torque_has_a_dash_for_it(
    simulated, tmp_path
):
    result, truth = simulated
    linear = identify(result.data, Linear(check=False), against={"truth": truth})
    write_report(linear, tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text(encoding="utf-8")
    row = re.search(r"<tr><td>this identification</td>(.*?)</tr>", text, re.DOTALL)[1]
    cells = re.findall(r"<td>(.*?)</td>", row)
    assert cells[4] == "–"
    assert cells[5:] == [
        f"{v:.1f}" for v in (linear.summary.median, linear.summary.mean, linear.summary.worst)
    ]


def test_the_lines_of_the_frequency_response_are_the_state_space_s(simulated):
    result, _ = simulated
    parameters = result.estimate.parameters
    figure = frequency_response_figure(result)
    drawn = [trace for trace in figure.data if trace.mode == "lines"]
    assert len(drawn) == 2 * len(result.data.masses)
    for mass, (gain, phase) in zip(
        result.data.masses, zip(drawn[::2], drawn[1::2], strict=True), strict=True
    ):
        system = linearised(parameters, mass, pade_order=0)["angle", "command"]
        expected = system(1j * gain.x) * np.exp(-1j * gain.x * parameters.delay)
        np.testing.assert_allclose(gain.y, np.abs(expected), rtol=1e-8)
        turn = np.exp(1j * np.radians(phase.y))
        np.testing.assert_allclose(turn, expected / np.abs(expected), rtol=1e-8)


def test_a_page_s_time_series_are_the_points_of_each_log_s_own_figure(simulated):
    runs = simulated[0].free_runs
    shown = json.loads(json.dumps(time_figures(runs)))
    assert len(shown["curves"]) == len(runs)
    for run, curves in zip(runs, shown["curves"], strict=True):
        x, *ys = map(_numbers, curves)
        drawn = time_figure(run)
        assert [trace["name"] for trace in shown["data"]] == [trace.name for trace in drawn.data]
        for y, trace in zip(ys, drawn.data, strict=True):
            _assert_seen(x, trace.x)
            _assert_seen(y, trace.y)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine to look at the report")
def test_a_browser_draws_every_figure_without_error_or_request(page, tmp_path):
    command = [CHROMIUM, *FLAGS.split(), f"--user-data-dir={tmp_path}", page.as_uri()]
    seen = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)  # noqa: S603 - our own page
    assert "CONSOLE" not in seen.stderr
    assert seen.stdout.count('class="main-svg"') >= 2
    assert len(re.findall(r'class="trace scatter', seen.stdout)) > 20
    assert 'aria-selected="true"' in seen.stdout


def test_health_rows_find_the_frequency_and_the_swing(sine_log, tmp_path):
    clean, health = examine(sine_log)
    rows = dict(health_rows(clean, health))
    assert float(rows["dominant frequency"].split()[0]) == pytest.approx(5, abs=0.1)
    assert float(rows["amplitude"].split()[0]) == pytest.approx(0.1, rel=1e-2)
    assert rows["findings"] == "none"
    write_inspection(clean, health, tmp_path / "log.html")
    assert "angle in rad" in (tmp_path / "log.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (2.4771657, 0.0317, "2.477"),
        (0.0020999, 2.8e-5, "0.002100"),
        (-0.00016051, 0.0011, "-0.00016"),
        (123.4, 1.2, "123.4"),
        (1234.0, 12.0, "1234"),
        (0.5, float("nan"), "0.5"),
        (0.0, 0.1, "0"),
        (-1.0e-5, 0.0011, "-1e-05"),
    ],
)
def test_values_are_written_to_the_second_digit_of_their_error(value, error, text):
    assert with_error(value, error) == text


def test_an_interval_without_limits_is_a_dash():
    assert interval(float("nan"), 1.0) == "–"
    assert interval(1.0, 2.0) == "[1.00, 2.00]"
