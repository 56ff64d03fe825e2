"""Results show, tabulate, save and report themselves; verbs take whatever holds data."""

import re
from dataclasses import replace
from html import unescape

import numpy as np
import pandas as pd
import pytest
import yaml

import butterfly as bf
from butterfly.files import write_document
from butterfly.logs.mat import write_mat
from butterfly.verdict import Level
from tests.api.conftest import OF_ESTIMATE, OTHERS, results_of
from tests.verdicts import follow_nothing


def test_a_zero_is_told_of_logs_and_of_whatever_is_read(quick_data, data):
    log = bf.Log(*(getattr(data.logs[0], name) for name in ("time", "input", "angle")), zero=0.2)
    for told in (bf.read(quick_data, zero=0.2), bf.read(data, zero=(0.2, 0.0)), bf.read(log)):
        assert {each.value for each in told.offsets} == {0.2}
        assert told.unread == []
    with pytest.raises(bf.InputError, match="zero"):
        bf.read(data, zero="left")


def test_the_encoder_s_zero_is_a_row_of_the_answer_is_saved_and_reaches_the_twin(results, tmp_path):
    found = results["identification"]
    found.save(tmp_path / "r.json")
    loaded, (zero,) = bf.load(tmp_path / "r.json"), {*found.zeros.values()}
    assert zero == found.estimate.local[None]["zero"]
    row = ("zero", f"{zero:z.4f}", "rad", "encoder's angle less the model's")
    for each in (found, loaded):
        assert row in [line for table in each.tables() for line in table.rows]
        assert each.to_dict()["zeros"] == dict.fromkeys(found.fits, zero)
        assert each.model.twin().zeros == (*found.zeros.values(),)


def shown(result):
    """What a result shows on a console, in a frame, on its page without figures."""
    page = result.page()
    return (
        *(str(result), repr(result), result.paragraphs(), result.tables(), result.rows()),
        *(page.name, page.description, page.headed, page.summary, page.facts),
        [(table.headers, [*table.rows]) for part in page.parts for table in part.tables],
    )


def assert_begins_alike(answer):
    """A notebook's cell begins with the lines that `print` begins with, the whole verdict in it."""
    paragraphs = re.findall(r"<p>(.*?)</p>", answer._repr_html_(), re.DOTALL)
    lines = [unescape(re.sub(r"<[^>]+>", "", text)) for text in paragraphs]
    first = [line.replace("`", "") for line in answer.first_lines]
    assert {*answer.headline, *answer.verdict} <= {*answer.first_lines}
    assert str(answer).splitlines()[: len(first)] == [*answer.first_lines]
    assert lines[: len(first)] == first


def test_a_notebook_says_first_whether_an_orbit_is_held_then_the_verdict(results):
    found = results["planned"]
    held = "Held: an orbit of 60°."
    for level in (Level.GOOD, Level.WARNING):
        judged = replace(found.judged, level=level)
        said = (held, *judged.lines) if level.usable else (*judged.lines, held)
        answer = replace(found, summary=said, judged=judged)
        assert_begins_alike(answer)
        assert held in answer._repr_html_()


ANSWERS = {"validation", "design", "comparison", "prediction", "selection", "planned"}
"""Results that say what was asked before the verdict that it rests on."""


@pytest.mark.parametrize("kind", [*OF_ESTIMATE, *OTHERS])
def test_a_result_says_its_verdict_first_shows_saves_and_reports_itself(results, kind, tmp_path):
    each = results[kind]
    if kind not in {"leaderboard", "change", "inspection", "one log"}:  # which rest on no one fit
        assert each.standing == each.to_dict()["verdict"] == "good"
        lines = each.page().verdict.lines
        before = len(each.headline)
        assert before == (kind in ANSWERS)
        assert tuple(each.verdict[:2]) == each.summary[before : before + 2] == lines
        assert lines[0].startswith("Good: p1 ±")
        assert lines[1].startswith("Model: error ")
    assert len(repr(each).splitlines()) == 1
    assert "good" not in repr(each)
    assert len(each.to_dataframe()) == len(each.rows()) > 0
    cell = each._repr_html_()
    assert "<table" in cell
    assert_begins_alike(each)
    each.save(tmp_path / "r.json")
    again = bf.load(tmp_path / "r.json")
    assert again.to_dict() == each.to_dict()
    assert shown(again) == shown(each)
    pd.testing.assert_frame_equal(again.to_dataframe(), each.to_dataframe())
    again.report(tmp_path / "page.html")
    assert (tmp_path / "page.html").stat().st_size > 5e3


def test_a_result_not_to_be_used_says_so_in_its_repr_and_its_words(few, monkeypatch):
    follow_nothing(monkeypatch)
    for each in results_of(bf.identify(few.data, terms=())).values():
        assert each.standing == "do not use"
        assert each.verdict[0].startswith("Do not use: ")
        assert str(each).splitlines()[1] == each.verdict[0]
        assert ", do not use" in repr(each)


@pytest.mark.parametrize("kind", ["physical", "validation", "leaderboard", "comparison", "model"])
def test_rows_that_are_gone_or_lack_a_column_are_refused(results, kind, tmp_path):
    whole, key = results[kind].to_dict(), "entries" if kind == "leaderboard" else "rows"
    first, *others = whole[key]
    lacking = [
        {k: v for k, v in first.items() if k != name}
        for name in first
        if others and kind != "leaderboard"
    ]
    for rows in ([], *([each, *others] for each in lacking)):
        write_document({**whole, key: rows}, tmp_path / "r.json")
        with pytest.raises(bf.InputError, match="content: got"):
            bf.load(tmp_path / "r.json")
        (tmp_path / "r.json").unlink()


def test_what_has_no_verdict_says_none(results):
    found = results["validation"]
    content = {key: value for key, value in found.to_dict().items() if key != "verdict"}
    older = bf.Answer.from_dict(content)
    assert (older.standing, older.verdict, older.to_dict()["verdict"]) == (None, [], None)
    assert older.page().summary == list(found.summary)


@pytest.mark.parametrize("kind", ["comparison", "draws", "residual", "validation"])
def test_an_older_result_of_a_kind_whose_keys_changed_is_to_be_saved_again(results, kind, tmp_path):
    write_document(results[kind].to_dict() | {"schema_number": 4}, tmp_path / "r.json")
    with pytest.raises(bf.InputError, match=r"got 4; expected 5: .* save again"):
        bf.load(tmp_path / "r.json")


def test_several_sources_are_read_together_each_with_its_own_repairs(data, sine_log, tmp_path):
    spoilt = replace(sine_log, angle=np.where(np.arange(40_000) == 7, np.nan, sine_log.angle))
    write_mat(spoilt, tmp_path / "a.mat")
    manifest = {"name": "a", "input": "voltage", "arm": 0.1, "repair": ["non_finite"]}
    manifest["logs"] = [{"file": "a.mat", "added_mass": 0.05}]
    manifest["known"] = {"p4": 0.5}
    (tmp_path / "manifest.yaml").write_text(yaml.safe_dump(manifest))
    together = bf.read([tmp_path, data, sine_log])
    assert len(together.logs) == 1 + len(data.logs) + 1
    assert together.known.fixed == {"p4": 0.5}
    assert bf.read([tmp_path]).manifest is not None


def test_logs_are_made_of_lists_and_frames_alike():
    time = np.linspace(0, 1, 50)
    frame = pd.DataFrame({"t": time, "u": np.sin(time), "q": np.cos(time), "dq": -np.sin(time)})
    one = bf.Log.from_frame(frame, time="t", input="u", angle="q", velocity="dq")
    two = bf.Log(list(time), frame["u"], tuple(frame["q"]), frame["dq"], input_kind="torque")
    for name, column in one.columns().items():
        assert column.dtype == np.float64
        np.testing.assert_array_equal(column, two.columns()[name])
    assert two.input_kind is bf.InputKind.TORQUE
    assert len(repr(one).splitlines()) == 1
