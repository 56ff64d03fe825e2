"""The page of an identification: whole, offline, and true to the numbers."""

import dataclasses
import html
import re

import numpy as np
import pytest

from butterfly.api.verbs import identify
from butterfly.identification.estimators import Linear
from butterfly.identification.trust import Finding, FindingKind
from butterfly.report.finding_texts import estimate_verdict, finding_text
from butterfly.report.log_figures import residual_sentences, residual_table
from butterfly.report.parameter_table import parameter_table
from butterfly.report.summary import summary
from butterfly.verdict import Level
from tests.report.browser import needs_chromium, seen_by_chromium


def test_the_page_holds_every_parameter_log_and_sentence_and_asks_nothing_of_the_network(
    page, simulated
):
    text = html.unescape(page.read_text(encoding="utf-8"))
    markup = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", markup)
    assert "@import" not in markup
    result, truth = simulated
    columns = ("meaning", "value", "standard error", "95 % interval", "true", "deviation")
    for row in parameter_table("", result.estimate.table(truth), "name", *columns).rows:
        assert all(cell in text for cell in row)
    said = estimate_verdict(result.estimate)
    assert f'<div class="verdict {said.level}">' in text
    for sentence in (*said.reasons, *summary(result)[2:], *residual_sentences(result.residuals)):
        assert sentence in text
    assert text.count('<tr class="pick"') == 2 * len(result.data.logs) == 18
    cells = [cell for row in residual_table(result.residuals.logs, []).rows for cell in row]
    assert all(cell in text for cell in cells)


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


def test_a_footer_says_what_was_run_on_which_data_when_and_with_what(simulated, page, monkeypatch):
    text = html.unescape(page.read_text(encoding="utf-8"))
    footer = text[text.index("<footer>") :]
    for said in ("made from Python", "quickstart", "output-error", "<dt>date</dt>", "numpy "):
        assert said in footer
    monkeypatch.setattr("sys.argv", ["/bin/butterfly", "identify", "my logs", "-r", "x.html"])
    origin = simulated[0].page().origin
    assert origin["command"] == "butterfly identify 'my logs' -r x.html"
    assert list(origin) == ["command", "folder", "data", "options", "date", "versions"]


def test_cause_and_cure_of_a_doubted_answer_are_on_the_first_screen_and_said_once(simulated):
    result, _ = simulated
    doubt, cause = Finding(FindingKind.APPROXIMATE), Finding(FindingKind.REST_DIFFERS, number=0.1)
    estimate = result.estimate.with_findings(doubt, cause)
    page = dataclasses.replace(result, estimate=estimate).page()
    assert page.headed.level is Level.CARE
    first, values, *_ = page.headed.reasons
    assert first == finding_text(cause, {})
    assert "fast look" in values
    assert first in page.summary
    assert first not in page.findings


@needs_chromium
def test_the_whole_table_of_parameters_is_seen_at_1280_pixels(page, tmp_path):
    measure = (
        "<script>const shown = document.querySelector('#lead .scroll');"
        "document.title = `${shown.scrollWidth} in ${shown.clientWidth}`;</script>"
    )
    path = tmp_path / "page.html"
    path.write_text(page.read_text(encoding="utf-8") + measure, encoding="utf-8")
    seen = seen_by_chromium(path, tmp_path, "--window-size=1280,900")
    wide, room = map(int, re.search(r"<title>(\d+) in (\d+)</title>", seen).groups())
    assert wide <= room
    assert ">deviation</th>" in seen
