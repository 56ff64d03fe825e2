"""Every kind of report in a browser: no error, no request, every figure drawn; and its pictures."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from butterfly.api.comparison import comparison_answer
from butterfly.api.prediction import predict
from butterfly.api.validation import ranking_answer
from butterfly.api.verbs import identify
from butterfly.comparison.answers import leaderboard
from butterfly.comparison.three_way import compare_three
from butterfly.experiment.record import EstimateRecord, Outcome, RunRecord, SweepRecord, SweepRun
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep_tables import ESTIMATES, RUNS
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, Linear
from butterfly.identification.free_run import FitSummary
from butterfly.identification.residuals import residuals_of
from butterfly.identification.trust import Ending
from butterfly.model.prior import Prior
from butterfly.orbit.loop import study_orbit
from butterfly.report.orbit_page import orbit_page
from butterfly.report.page import write_page
from butterfly.report.sweep_page import sweep_page
from butterfly.thesis.method import Thesis
from tests.identification.simulated import estimate_of
from tests.orbit.setting import grey_rig, plant, sixty_degrees, two_sines, wrong
from tests.report.browser import HASTE, needs_chromium, seen_by_chromium

pytestmark = pytest.mark.slow

KINDS = ("identification", "three-way", "leaderboard", "orbit", "sweep", "prediction")
ROUGH = plant({"coulomb": 1e-4})


@pytest.fixture(scope="module")
def data():
    """Six short sines with three added masses."""
    bench = plant({"coulomb": 1e-4}, step=0.004)
    return DataSet.of(two_sines(bench, (0.0, 0.05, 0.1), 40.0), name="six sines")


@pytest.fixture(scope="module")
def found(data):
    return HarmonicBalance()(data)


@pytest.fixture(scope="module")
def residuals(data, found):
    return residuals_of(data, found)


def _orbit_page():
    rng = np.random.default_rng(0)
    rig = grey_rig(ROUGH, rng)
    believed = wrong(ROUGH.robot.lumped, rng)
    plan = sixty_degrees(duration=12.0, starts=(0.6, 1.5), cross_check=(0.8, 1.0))
    study = study_orbit(rig, believed, 0.0, plan, rng=rng)
    return orbit_page(study, ROUGH.robot.lumped)


def _sweep_page(folder):
    """A sweep of 60 runs over a number, a decade, a name; two of them without a result."""
    rng = np.random.default_rng(0)
    store = ResultStore(folder)
    fields = ["plant.hand.mass", "plant.encoder.noise", "method"]
    runs = []
    for number in range(60):
        values = (0.1 + 0.01 * number, 10 ** rng.uniform(-5, -2), "ab"[number % 2])
        place = {"key": f"{number:024d}", "repetition": 0, "seed": number}
        place["overrides"] = dict(zip(fields, values, strict=True))
        runs.append(SweepRun(number=number, **place))
        status = {7: "refused", 8: "failed"}.get(number, "ok")
        names = ("p1", "p3")
        values = np.array([rng.normal(1, 0.05) for _ in (*names, "p4")])
        known = Prior.of({"p4": values[2]})
        found = replace(
            estimate_of(values[:2], np.diag([0.05**2] * 2), known, names),
            lower=np.full(2, 0.9),
            upper=np.full(2, 1.1),
            ending=Ending.STOPPED if number == 9 else Ending.CONVERGED,
        )
        estimate = EstimateRecord(
            estimator="m",
            estimate=found,
            truth=dict.fromkeys(("p1", "p3", "p4"), 1.0),
            fit=FitSummary(99.0, 99.0, 99.0),
        )
        estimates = (estimate,) if status == "ok" else ()
        store.write(Outcome(record=RunRecord(**place, status=status, estimates=estimates)))
    about = {"name": "sixty", "description": "", "seed": 0, "versions": {}, "worst": 5}
    sweep = SweepRecord(**about, fields=tuple(fields), runs=tuple(runs))
    store.end_sweep(sweep)
    return sweep_page(store.sweep(), store.table(RUNS), store.table(ESTIMATES))


@pytest.fixture(scope="module")
def pages(data, found, residuals, tmp_path_factory):
    identified = identify(data)
    compared = compare_three(data, found, (0, 3, 4))  # each mass, each sine
    entries = leaderboard([data], [Thesis(), Linear(), HarmonicBalance()])
    return {
        "identification": replace(identified, truth=ROUGH.robot.lumped).page(),
        "three-way": comparison_answer(data, None, compared, residuals, found).page(),
        "leaderboard": ranking_answer(entries).page(),
        "orbit": _orbit_page(),
        "sweep": _sweep_page(tmp_path_factory.mktemp("sixty")),
        "prediction": predict(data, identified, draws=40).page(),
    }


def test_the_report_of_a_sweep_counts_verdicts_and_lists_what_went_wrong(pages):
    page = pages["sweep"]
    assert page.summary[0].startswith("Half of all estimates are within ")
    assert "2 runs without a result: `butterfly inspect FOLDER/NUMBER` says why." in (page.summary)
    assert any(each.startswith("60 runs, 58 ") for each in page.summary)
    assert "Verdicts on 58 estimates: 0 good, 57 use with care, 1 do not use." in page.summary
    assert any("1 of 58" in each for each in page.summary)
    assert (page.numbers["ok"], page.numbers["unconverged"]) == (58, 1)
    assert page.numbers["verdicts"] == {"m": {"good": 0, "use with care": 57, "do not use": 1}}
    recovered = [each["parameter"] for each in page.numbers["recovery"]]
    assert recovered == ["p1", "p3"]  # not p4, which was known
    rows = {each.title: each.tables[0].rows for each in page.sections if each.tables}
    assert rows["Verdicts"] == [("m", "0", "57", "1")]
    (unconverged,) = rows["Estimates that did not converge"]
    assert [str(cell) for cell in unconverged] == ["9", "m", "stopped", ""]
    assert [row[1] for row in rows["Runs without a result"]] == ["refused", "failed"]
    assert len(rows["Worst runs"]) == 5
    link = rows["Worst runs"][0][0]
    assert link.href == f"runs/00/{int(link.text):024d}.json"
    (pairs,) = [each for each in page.sections if each.title == "Two fields at a time"]
    assert len(pairs.figures) == 3


def test_a_page_that_rests_on_an_estimate_says_its_verdict(pages):
    for kind, page in pages.items():
        assert (page.verdict is None) == (kind == "sweep")
        if page.verdict is not None:
            assert page.numbers["verdict"] == page.verdict.level.verdict
            assert not {*page.verdict.lines} & {*page.summary}


@pytest.fixture(scope="module")
def written(pages, tmp_path_factory):
    """Where each page is written."""
    folder = tmp_path_factory.mktemp("pages")
    for kind, page in pages.items():
        write_page(page, folder / kind / "r.html", figures=True)
    return folder


def test_pictures_are_drawn_only_if_asked_for(pages, tmp_path):
    write_page(pages[KINDS[0]], tmp_path / "r.html")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["r.html", "r.json"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_report_is_written_with_its_numbers_and_pictures(pages, written, kind):
    page, folder = pages[kind], written / kind
    text = (folder / "r.html").read_text(encoding="utf-8")
    markup = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", markup)
    assert json.loads((folder / "r.json").read_text())
    names = {*page.figures, *page.pictures}
    assert set(page.series) <= {*page.pictures}
    assert names
    for name in names:
        for suffix in ("png", "svg"):
            assert (folder / f"r-figures/{name}.{suffix}").stat().st_size > 3000


@needs_chromium
@pytest.mark.parametrize("kind", KINDS)
def test_a_browser_draws_every_figure_without_error_or_request(pages, written, kind, tmp_path):
    dom = seen_by_chromium(written / kind / "r.html", tmp_path, HASTE)
    page = pages[kind]
    assert len(re.findall(r'class="figure js-plotly-plot"', dom)) == len(page.figures)
    assert len(re.findall(r'class="series js-plotly-plot"', dom)) == len(page.series)
    picked = any(table.picks for part in page.parts for table in part.tables)
    assert ('aria-current="true"' in dom) == picked


def test_a_line_of_all_fields_at_once_is_an_estimate(pages):
    (section,) = [each for each in pages["sweep"].sections if each.title == "All fields at once"]
    figure = section.figures["together"]
    lines = [trace for trace in figure.data if trace.name]
    ends = [np.isnan(np.asarray(trace.y, dtype=float)).sum() for trace in lines]
    assert sum(ends) == 58
    assert max(ends) - min(ends) <= 1  # quarters
    assert np.nanmin([np.nanmin(t.y) for t in lines]) == 0
    assert np.nanmax([np.nanmax(t.y) for t in lines]) == 1
    axes = list(figure.layout.xaxis.ticktext)
    assert axes[:3] == ["hand mass<br>in kg", "encoder noise<br>in rad", "method"]
    assert {"a", "b", "99"} <= {note.text for note in figure.layout.annotations}
