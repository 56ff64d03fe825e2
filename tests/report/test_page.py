"""A page: the answer stands first, texts are no markup; saved, it opens no connection."""

import base64
import gzip
import re
from dataclasses import replace
from pathlib import Path

import pytest
from plotly.graph_objects import Figure, Scatter

import butterfly.report
from butterfly.report.figures import Series
from butterfly.report.page import (
    Marked,
    Page,
    PageTable,
    Section,
    cell_html,
    rendered,
    write_page,
)
from butterfly.verdict import Level, Verdict
from tests.report.browser import HASTE, needs_chromium, opened, seen_by_chromium
from tests.report.setting import ODD

SOURCES = Path(butterfly.report.__file__).parent
ADDRESS = re.compile(r"(?<![\w:+/])(?:[a-z]+:)?//[\w-]+\.[\w.-]+[^\s\"'`)<>,;]*")
QUOTED = re.compile(r"[\"'`]((?:[a-z]+:)?//[^\s\"'`]+)")
LEADING = re.compile(r"<\w+\b[^<>]*(?:href|src|action|content)\s*=\s*[\"']?(?:\w+:)?//")
NAMESPACES = "http://www.w3.org/"
"""What begins the names of SVG, XLink and the like, which nobody opens."""

UNOPENED = {
    "https://plotly.com/": "displaylogo: false",
    "https://cloud.plotly.com/newchart": 'plotlyServerURL: ""',
    "https://cdn.plot.ly/un/": "no maps among cartesian figures",
    "https://github.com/d3/d3-format/tree/v1.4.5#d3-format": "in the text of a hint",
    "https://github.com/d3/d3-time-format/tree/v2.2.3#locale_format": "in the text of a hint",
}
"""All other addresses in plotly.js, and why none is opened."""

ASKING = """<img src="http://one.example/a.png"><script>
fetch("https://two.example/b").catch(() => 0);
navigator.sendBeacon("http://three.example/c", "d");
new WebSocket("ws://four.example/e");
</script>"""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A page with a figure, one of each log, and names that would be addresses."""
    named = "<a href='http://name.example/'>n</a><img src=//name.example/n.png>"
    figure = Figure([Scatter(x=[0, 1], y=[1, 2])])
    section = Section(
        title="t", figures={"one": figure}, series={"two": Series.of_figures([figure, figure])}
    )
    path = tmp_path_factory.mktemp("page") / "r.html"
    write_page(Page(name=named, description="", kind="sweep", sections=[section]), path)
    return path


def _program(page):
    """What a page draws with, unpacked."""
    packed = re.search(
        r'<script id="program".*?>(.*?)</script>', page.read_text("utf-8"), re.DOTALL
    )
    return gzip.decompress(base64.b64decode(packed[1])).decode()


def _without_scripts(text):
    return re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)


def test_no_address_is_in_a_page(page):
    text = page.read_text("utf-8")
    own = re.sub(r'<script id="program".*?</script>', "", text, flags=re.DOTALL)
    assert [each for each in ADDRESS.findall(own) if "name.example" not in each] == []
    assert LEADING.findall(own) == []
    program = {each for each in QUOTED.findall(_program(page)) if not each.startswith(NAMESPACES)}
    assert program == set(UNOPENED)


def test_no_template_has_an_address():
    for path in (SOURCES / "templates").iterdir():
        assert ADDRESS.findall(path.read_text(encoding="utf-8")) == [], path.name


def test_plotly_shows_its_upload_only_where_it_is_asked_to_and_no_page_does(page):
    program = _program(page)
    bundle, own = (
        program[: program.index("const OPTIONS")],
        program[program.index("const OPTIONS") :],
    )
    uses = re.findall(r"(\w+\.)?showSendToCloud(&&\w+\.push\(\"sendChartToCloud\"\))?", bundle)
    assert sorted(bool(pushed) for _, pushed in uses) == [False, True]  # its default, its one use
    assert bundle.count('"sendChartToCloud"') == 2  # that use, and the button's own name
    options = re.search(r"const OPTIONS = \{(.*?)\};", own, re.DOTALL)[1]
    assert "showSendToCloud: false" in options
    assert 'plotlyServerURL: ""' in options
    assert "displaylogo: false" in options
    drawn = re.findall(r"Plotly\.\w+\(\w+, (\.\.\.themed\()?", own)
    assert len(drawn) == own.count("Plotly.") == 2
    assert all(drawn)
    assert "{...OPTIONS," in re.search(r"function themed.*?\n\}", own, re.DOTALL)[0]


@needs_chromium
def test_a_browser_without_a_network_draws_a_page_that_asks_for_nothing(page, tmp_path):
    dom = seen_by_chromium(page, tmp_path, HASTE)
    assert len(re.findall(r'class="(?:figure|series) js-plotly-plot"', dom)) == 2
    buttons = re.findall(r'data-title="([^"]*)"', dom)
    assert buttons.count("Download plot as a PNG") == 2
    assert [each for each in buttons if re.search("share|cloud|upload", each, re.IGNORECASE)] == []
    assert LEADING.findall(_without_scripts(dom)) == []


@needs_chromium
def test_a_browser_notices_what_a_page_asks_for_and_a_page_of_ours_may_not(page, tmp_path):
    other = tmp_path / "asking.html"
    other.write_text(f"<!doctype html><body>{ASKING}</body>", encoding="utf-8")
    _, asked = opened(other, tmp_path, HASTE)
    hosts = {each.split("/")[2] for each in asked}
    assert hosts == {f"{each}.example" for each in ("one", "two", "three", "four")}
    other.write_text(page.read_text("utf-8").replace("</body>", f"{ASKING}</body>"), "utf-8")
    seen, asked = opened(other, tmp_path, HASTE)
    assert asked == []
    assert seen.stderr.count("Content Security Policy") >= len(hosts)


def test_a_page_runs_no_text(tmp_path):
    script = ODD[-1]
    figure = Figure([Scatter(x=[script], y=[1], name=f"</script>{script}")])
    rows = [(script,), (Marked(script, "runs/x.json"),)]
    parts = {"text": script, "tables": (PageTable(headers=(script,), rows=rows, caption=script),)}
    section = Section(title=script, figures={"f": figure}, **parts)
    about = {"name": script, "description": script, "kind": "sweep", "numbers": {script: 1}}
    write_page(Page(**about, summary=[script], sections=[section]), tmp_path / "page.html")
    assert "<script>alert" not in (tmp_path / "page.html").read_text()


def _page(kind, verdict):
    about = {"name": "n", "description": "", "kind": kind, "numbers": {}, "verdict": verdict}
    return Page(**about, summary=["Said."], lead=Section(title="Lead"), sections=[])


def test_the_answer_stands_first_be_it_a_verdict_or_words():
    judged = rendered(_page("comparison", Verdict(Level.GOOD, ("p1 within 1 %.",))))
    assert judged.index("Parameters: good") < judged.index("Lead") < judged.index("Said.")
    plain = rendered(_page("change", None))
    assert plain.index("Said.") < plain.index("Lead")


def test_long_words_in_tables_may_be_broken_and_numbers_may_not():
    table = PageTable(headers=("log", "FIT"), rows=[("x" * 50, "99.6")])
    page = _page("identification", None)
    text = rendered(replace(page, sections=[Section(title="Logs", tables=(table,))]))
    assert f'<td class="long">{"x" * 50}</td><td>99.6</td>' in text


def test_in_a_notebook_a_number_stays_with_its_unit_on_one_line():
    page = Page(name="A", description="", kind="k", lead=Section(title="Lead"))
    assert ".butterfly-result td { white-space: nowrap; }" in cell_html(page, ["A"], Figure())


def test_what_was_asked_comes_before_the_verdict_s_reasons():
    verdict = Verdict(Level.GOOD, ("p1 ±1 %.",))
    page = Page(name="n", description="", kind="prediction", verdict=verdict, asked=["24 logs."])
    assert page.headed.reasons == ["24 logs.", "p1 ±1 %."]


def test_a_command_in_a_sentence_is_code_and_nothing_else_is_markup():
    said = ["Next: `butterfly design <b>`.", "a ` alone <i>"]
    text = rendered(Page(name="n", description="", kind="sweep", summary=said))
    assert "<p>Next: <code>butterfly design &lt;b&gt;</code>.</p>" in text
    assert "<p>a ` alone &lt;i&gt;</p>" in text
