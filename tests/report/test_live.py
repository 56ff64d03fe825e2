"""Whoever reads a page moves its sliders, plays it and looks at another log."""

import html
import json
import re
from pathlib import Path

import pytest

from butterfly.api.verbs import identify
from butterfly.identification.data import DataSet
from butterfly.report.live import Slider
from tests.orbit.setting import plant, two_sines
from tests.report.browser import needs_chromium, seen_by_chromium
from tests.report.setting import parameter_row

READER = Path(__file__).parent / "reader.js"
HEARD = """window.errors = [];
addEventListener("error", (event) => window.errors.push(event.message));
addEventListener("unhandledrejection", (event) => window.errors.push(String(event.reason)));"""


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """What a reader of the page of a small data set sees in Chromium."""
    folder = tmp_path_factory.mktemp("live")
    logs = two_sines(plant({"coulomb": 1e-4}, step=0.004), (0.0, 0.05), 20.0)
    data = DataSet.of(logs, name="four sines")
    page = folder / "r.html"
    identify(data).report(page)
    text, reader = page.read_text(encoding="utf-8"), READER.read_text(encoding="utf-8")
    text = text.replace("<head>", f"<head><script>{HEARD}</script>", 1)
    page.write_text(text.replace("</body>", f"<script>{reader}</script></body>", 1), "utf-8")
    (found,) = re.findall('<pre id="seen">(.*?)</pre>', seen_by_chromium(page, folder), re.DOTALL)
    return json.loads(html.unescape(found))


@needs_chromium
@pytest.mark.slow
def test_a_page_simulates_without_error_or_request(seen):
    assert seen["errors"] == seen["requests"] == []
    assert float(seen["first"]["fit"].removesuffix(" %")) > 90


@needs_chromium
@pytest.mark.slow
def test_a_slider_changes_the_fit_and_as_identified_restores_it(seen):
    first, moved, reset = (seen[name] for name in ("first", "moved", "reset"))
    assert first["fit"] in first["identified"]
    assert moved["fit"] != first["fit"]
    before, after = (float(each["fit"].removesuffix(" %")) for each in (first, moved))
    assert after < before - 5  # the ghost parts
    assert moved["residual"] != first["residual"]
    assert moved["pictures"][0] != first["pictures"][0]
    assert moved["fit"] in moved["plot"]
    assert reset == first


@needs_chromium
@pytest.mark.slow
def test_a_screen_reader_names_every_slider_and_its_value(seen):
    assert len({each["name"] for each in seen["controls"]}) == len(seen["controls"]) > 4
    assert all(each["name"] and each["text"] for each in seen["controls"])
    texts = {each["id"]: each["text"] for each in seen["controls"]}
    moved = {each["id"]: each["text"] for each in seen["moved_controls"]}
    assert {name for name, text in moved.items() if text != texts[name]} == {"live-p1"}
    assert texts["live-p1"].endswith("as identified")


@needs_chromium
@pytest.mark.slow
def test_the_joint_plays_and_another_log_is_shown(seen):
    reset, played, whole, other = (seen[name] for name in ("reset", "played", "whole", "other"))
    assert played["clock"] != reset["clock"]
    assert played["pictures"][1] != reset["pictures"][1]
    assert float(seen["scrubbed"]["clock"].removesuffix(" s")) == pytest.approx(20.0, abs=0.011)
    assert whole["clock"] == "0.00 s"
    assert whole["pictures"][0] != reset["pictures"][0]
    assert whole["fit"] == reset["fit"] != other["fit"]
    assert other["plot"] != whole["plot"]


def test_a_slider_reaches_half_its_value_however_narrow_the_interval_is():
    narrow = Slider.of(parameter_row(value=2.0, lower=1.999, upper=2.001))
    assert narrow.reach == pytest.approx(1.0)
    wide = Slider.of(parameter_row(value=2.0, lower=1.0, upper=3.0))
    assert wide.reach == pytest.approx(3.0)
