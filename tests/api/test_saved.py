"""A saved result comes back whole and finds its logs; what is none is refused with what to do."""

import json
import shutil
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import butterfly as bf
from butterfly.identification.estimators import OutputError


def test_what_was_saved_is_a_model_and_finds_its_logs(result, data, tmp_path):
    assert result.to_dict()["data"]["manifest"]["root"] is None
    result.save(tmp_path / "r.json")
    again = bf.load(tmp_path / "r.json")
    np.testing.assert_array_equal(again.covariance, result.covariance)
    assert again.estimate.left_out.keys() == result.estimate.left_out.keys()
    assert again.model.resonance() == result.model.resonance()
    assert again.data.logs[0].source == data.logs[0].source
    assert again.plot.time(0).data[1].name == "measured"


def test_a_result_above_its_logs_is_moved_with_them_and_any_finds_them_where_one_says(
    quick_data, tmp_path, monkeypatch
):
    shutil.copytree(quick_data, tmp_path / "a/logs")
    monkeypatch.chdir(tmp_path)
    found = bf.identify("a/logs", terms=())
    found.save("a/r.json")
    shutil.move("a", "b")
    monkeypatch.chdir("/")
    assert bf.load(tmp_path / "b/r.json").data.logs[0].name == found.data.logs[0].name
    shutil.move(tmp_path / "b/r.json", tmp_path / "r.json")
    with pytest.raises(bf.InputError, match="no such file"):
        _ = bf.load(tmp_path / "r.json").data
    assert bf.load(tmp_path / "r.json", root=tmp_path / "b/logs").data.logs


def test_local_values_and_unknown_ones_come_back(data, by_thesis, tmp_path):
    local = bf.identify(data.take([0, 5]), OutputError(terms=(), per_log=("zero",)))
    unknown = dict.fromkeys(by_thesis.estimate.resonances, float("nan"))
    lost = replace(by_thesis, estimate=replace(by_thesis.estimate, resonances=unknown))
    for each in (local, by_thesis, lost):
        each.save(tmp_path / "r.json")
        again, before = bf.load(tmp_path / "r.json").estimate, each.estimate
        assert again.local == before.local
        assert again.resonances.keys() == before.resonances.keys()
        np.testing.assert_array_equal([*again.resonances.values()], [*before.resonances.values()])
        np.testing.assert_array_equal(again.covariance, before.covariance)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "butterfly.report"}, "schema: got butterfly.report; expected a saved result"),
        ({"schema": []}, "schema: got"),
        ({"schema_number": 4}, "update butterfly"),
        ({"schema_number": 0}, "save again"),
        ({"schema_number": None}, "save again"),
        ({"parameters": {}}, "KeyError: .p1."),
        ({"condition": "x"}, "condition: got 'x'; expected .*, in an undamaged saved result"),
        ({"rivals": [{"values": {}}]}, r"rivals\.0\.values: got {}; expected"),
        ({"findings": [{"kind": "plant", "logs": 3}]}, r"findings\.0\.logs: got 3"),
        ({"fits": 3}, "content: got AttributeError"),
        ({"data": None}, "content: got AttributeError"),
        ({"data": {}}, "content: got KeyError"),
        ({"summary": "abc"}, "content: got TypeError"),
        ({"summary": [1]}, "content: got TypeError"),
        ({"estimator": 3}, "content: got TypeError"),
    ],
)
def test_another_file_is_refused_with_what_to_do(result, tmp_path, change, message):
    path = tmp_path / "r.json"
    path.write_text(json.dumps(result.to_dict() | change))
    with pytest.raises(bf.InputError, match=message):
        bf.load(path)


def _damaged(content):
    """Yield a mapping with each value replaced by another, or left out."""
    for key in content:
        for other in (None, [], {}, 0, "x", [[1.0]], [["a", "b"]]):
            yield {**content, key: other}
        yield {name: value for name, value in content.items() if name != key}


@pytest.mark.parametrize("part", [None, "data", "covariance", "parameters"])
def test_no_damage_passes_and_fails_later(few, tmp_path, part):
    path, whole = tmp_path / "r.json", few.to_dict()
    for damaged in _damaged(whole if part is None else whole[part]):
        path.write_text(json.dumps(damaged if part is None else {**whole, part: damaged}))
        with suppress(bf.InputError):
            loaded = bf.load(path)
            repr(loaded), str(loaded), loaded._repr_html_(), loaded.to_dict()
            if part == "data":
                bf.changed(loaded, loaded)


def test_what_an_older_program_saved_is_refused_in_a_line():
    with pytest.raises(bf.InputError, match="schema_number: got 1; expected 3: identify and save"):
        bf.load(Path(__file__).parents[1] / "data/older/identification.json")


@pytest.mark.parametrize("text", ["", "[1]", "{", "[" * 100_000, "\x00"])
def test_what_is_no_json_is_refused(tmp_path, text):
    path = tmp_path / "r.json"
    path.write_text(text)
    with pytest.raises(bf.InputError, match="saved result"):
        bf.load(path)


def test_a_result_of_arrays_says_that_its_logs_are_not_to_be_found(data, tmp_path):
    found = bf.identify(list(data.recorded), terms=())
    found.save(tmp_path / "r.json")
    again = bf.load(tmp_path / "r.json")
    with pytest.raises(bf.InputError, match="from one source of files"):
        _ = again.data
    with pytest.raises(bf.InputError, match="from one source of files"):
        again.report(tmp_path / "r.html", figures=True)
    assert again.page().summary[0].startswith("Without figures of the logs, which cannot be read")
    assert again.page().lead.tables[0].rows == found.page().lead.tables[0].rows
