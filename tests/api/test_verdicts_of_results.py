"""Every result that rests on an identification carries its verdict."""

import pytest

import butterfly as bf
from tests.verdicts import follow_nothing, impossible_data


@pytest.fixture(scope="module")
def data(quick_data):
    return bf.read(quick_data)


def _results(data, found):
    return (
        found,
        bf.validate(data),
        bf.design(found),
        bf.compare(found, logs=[0]),
        bf.predict(data, found, bands=False),
        bf.draws(found, 40),
    )


def test_a_good_result_says_so_first_and_its_repr_keeps_quiet(data):
    for each in _results(data, bf.identify(data)):
        assert each.standing == "good"
        assert each.verdict[0] == each.summary[0] == each.page().verdict.sentence
        assert "good" not in repr(each)
        assert each.to_dict()["verdict"] == "good"


def test_a_result_not_to_be_used_says_so_in_its_repr_its_words_and_its_file(
    data, monkeypatch, tmp_path
):
    follow_nothing(monkeypatch)
    for each in _results(data, bf.identify(data)):
        assert each.standing == "do not use"
        assert each.verdict[0].startswith("Do not use: ")
        assert str(each).splitlines()[1] == each.verdict[0]
        assert ", do not use" in repr(each)
        each.save(tmp_path / "r.json")
        again = bf.load(tmp_path / "r.json")
        assert again.judged == each.judged
        assert repr(again) == repr(each)


def test_what_an_older_program_saved_has_no_verdict(data):
    found = bf.validate(data)
    content = {key: value for key, value in found.to_dict().items() if key != "verdict"}
    older = type(found).from_dict(content)
    assert (older.standing, older.verdict) == (None, [])
    assert older.page().summary == list(found.summary)
    assert older.to_dict()["verdict"] is None


def test_nothing_is_made_of_values_that_no_joint_has(quick_data, tmp_path):
    found = bf.identify(impossible_data(quick_data, tmp_path / "data"))
    for asked in (
        lambda: bf.design(found),
        lambda: bf.compare(found),
        lambda: bf.predict(quick_data, found),
        lambda: bf.draws(found),
        lambda: found.model,
    ):
        with pytest.raises(bf.UnusableError, match=r"^Do not use: No joint has these values"):
            asked()
