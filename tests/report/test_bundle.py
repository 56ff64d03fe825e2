"""What is attached to a report of an error names nobody, and replaces nothing of anybody."""

import json
from zipfile import ZipFile

import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.outputs import mark_of
from butterfly.report import bundle

TEXTS = st.text(min_size=1).filter(lambda text: text not in bundle.WORDS)
LEAVES = st.none() | st.booleans() | st.floats(allow_nan=False) | TEXTS
DOCUMENTS = st.recursive(
    LEAVES, lambda part: st.lists(part, max_size=3) | st.dictionaries(TEXTS, part, max_size=3)
)


def _texts(value):
    """All texts and keys of a document."""
    if isinstance(value, dict):
        return [*value, *(text for part in value.values() for text in _texts(part))]
    if isinstance(value, list):
        return [text for part in value for text in _texts(part)]
    return [value] if isinstance(value, str) else []


@given(st.fixed_dictionaries(dict.fromkeys(bundle.OF_RESULT, DOCUMENTS)))
def test_no_text_of_a_result_is_in_its_judgement_but_words_of_the_program(result):
    words = _texts(bundle.judgement(result))
    assert all(word in bundle.WORDS or word.isdecimal() for word in words)


def test_an_error_says_where_it_was_raised_and_not_what_was_read():
    try:
        bundle.read_pieces(None, None)
    except AttributeError as error:
        failed = bundle.failure(error)
    assert failed["refused"] == "AttributeError"
    assert failed["at"][0].startswith("logs/reading.py:")
    named = bundle.failure(InputError("/folder/of/somebody/x.csv", "my column", "mine", "theirs"))
    assert named == {"refused": "InputError", "field": None, "at": []}


def test_without_data_there_are_versions():
    files = bundle.bundle_files(None, None)
    assert [*files] == [bundle.TEXT, bundle.NUMBERS]
    numbers = json.loads(files[bundle.NUMBERS])
    assert {"python", "system"} <= numbers["system"].keys()
    assert {"butterfly", "numpy", "mujoco"} <= numbers["packages"].keys()
    first, second = files[bundle.TEXT].splitlines()[:2]
    assert first == "Holds: the versions of Python, the system and the packages."
    assert second.startswith("Does not hold: names of files, folders, columns, joints, users")


def test_a_bundle_replaces_a_bundle_and_nothing_else(tmp_path):
    path = tmp_path / "report.zip"
    for text in ("one", "two"):
        bundle.write_bundle({"report.txt": text}, path)
    with ZipFile(path) as parts:
        assert parts.read("report.txt") == b"two"
        assert parts.comment.decode() == mark_of(path, "bundle")
        assert {part.date_time[0] for part in parts.infolist()} == {1980}
    with ZipFile(path, "w") as parts:
        parts.writestr("thesis.tex", "of somebody")
    with pytest.raises(InputError, match="an existing file of another kind"):
        bundle.write_bundle({"report.txt": "three"}, path)
