"""The logs of a manifest: pieces of files, and names."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.identification.data import DataSet, read_data_set
from butterfly.logs.manifest import Manifest, Recordings, manifest_text, read_manifest
from butterfly.logs.mat import write_mat
from butterfly.logs.reading import with_unique_names

TIME = np.arange(400) / 100
HEAD = "name: set\ninput: voltage\n"


@pytest.fixture
def folder(tmp_path):
    """Three recordings of 4 s, put together in a file."""
    rows = [(t, np.sin(3 * t + k), 0.3 * np.sin(3 * t + k - 0.5)) for k in range(3) for t in TIME]
    header = "time,input,angle"
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header=header, comments="")
    return tmp_path


def _read(folder, text):
    path = folder / "manifest.yaml"
    path.write_text(HEAD + text, encoding="utf-8")
    return read_data_set(read_manifest(path))


def test_recordings_put_together_are_split_where_the_clock_falls_back(folder):
    data = _read(folder, "split: restarts\nlogs: [{file: a.csv}]\n")
    assert [log.name for log in data.logs] == [f"a.csv (part {k})" for k in (1, 2, 3)]
    assert [log.time.size for log in data.logs] == [400] * 3
    assert all(log.lead is None for log in data.logs)
    assert data.logs[1].input[0] == pytest.approx(np.sin(1.0))


def test_pieces_have_names_and_what_was_commanded_before(folder):
    entries = "{file: a.csv, part: 2, from: 1.5, to: 3.2}, {file: a.csv, part: 3, to: 2}"
    data = _read(folder, f"logs: [{entries}]\n")
    first, second = data.logs
    assert first.name == "a.csv (part 2, 1.5 s to 3.2 s)"
    assert (first.time[0], first.time[-1]) == (1.5, 3.2)
    assert first.lead is not None
    np.testing.assert_allclose(first.lead.time, TIME[:150])
    np.testing.assert_allclose(first.lead.input, np.sin(3 * TIME[:150] + 1))
    assert second.name == "a.csv (part 3, start to 2 s)"
    assert second.lead is None


def test_a_part_of_the_set_is_read_again_by_its_own_manifest(folder):
    entries = "{file: a.csv}, {file: a.csv, part: 1, from: 1}"
    data = _read(folder, f"split: restarts\nlogs: [{entries}]\n")
    part = data.take([1, 3]).manifest
    (folder / "part.yaml").write_text(manifest_text(part), encoding="utf-8")
    again = Manifest.model_validate(part.model_dump(mode="json"))
    assert again == part
    for manifest in (again, read_manifest(folder / "part.yaml")):
        names = [log.name for log in read_data_set(manifest).logs]
        assert names == ["a.csv (part 2)", "a.csv (part 1, 1 s to end)"]


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{file: a.csv, part: 4}", "3, the recordings"),
        ("{file: a.csv, part: 1, from: 3.95}", "at least 16 samples within 0 s to 3.99 s"),
        ("{file: a.csv, from: 3, to: 2}", "from less than to"),
        ("{file: a.csv, split: restarts, from: 1}", "either split, or from"),
        ("{file: a.csv}", "stamps in ascending order"),
    ],
)
def test_what_is_no_piece_is_one_typed_error(folder, entry, said):
    with pytest.raises(InputError, match=said):
        _read(folder, f"logs: [{entry}]\n")


def test_a_piece_is_of_one_whole_log(folder):
    manifest = Manifest(name="set", root=str(folder), input="voltage", logs=[{"file": "a.csv"}])
    (entry,) = manifest.piece(1.0, None).logs
    assert (entry.begin, entry.end) == (1.0, None)
    split = manifest.model_copy(update={"split": Recordings.RESTARTS})
    assert len(read_data_set(split).logs) == 3
    twice = manifest.model_copy(update={"logs": manifest.logs * 2})
    for wrong, ends in ((twice, (None, 1.0)), (split, (1.0, None)), (manifest, (2.0, 1.0))):
        with pytest.raises(InputError):
            wrong.piece(*ends)


def _names(log, names):
    log = log.take(np.arange(20))
    return [each.name for each in with_unique_names([replace(log, name=name) for name in names])]


def test_the_first_of_a_name_keeps_it_and_others_get_numbers_that_none_has(sine_log):
    assert _names(sine_log, ["a", "a", "a (2)", "a"]) == ["a", "a (3)", "a (2)", "a (4)"]
    label = "50 g, 5 rad/s"
    assert _names(sine_log, ["", label, ""]) == [label, f"{label} (2)", f"{label} (3)"]


@given(names=st.lists(st.sampled_from(["", "a", "a (2)", "a (3)", "a (2) (2)"]), max_size=12))
def test_names_are_unique_and_stay_when_they_are(sine_log, names):
    named = _names(sine_log, names)
    assert len(set(named)) == len(named)
    assert _names(sine_log, named) == named
    assert set(filter(None, names)) <= set(named)


def test_a_file_listed_twice_gives_two_logs_of_different_names(tmp_path, sine_log):
    write_mat(sine_log, tmp_path / "a.mat")
    entry = "{file: a.mat, added_mass: 0.05, omega: 5, amplitude: 0.2}"
    data = _read(tmp_path, f"arm: 0.1\nlogs: [{entry}, {entry}]\n")
    for logs in (data.logs, data.recorded):
        assert [log.name for log in logs] == ["a.mat", "a.mat (2)"]
    assert {log.source for log in data.logs} == {str(tmp_path / "a.mat")}


def test_a_name_survives_repairs(sine_log):
    time = sine_log.time.copy()
    time[7] = time[6]
    data = DataSet.of([replace(sine_log, time=time, name="mine"), sine_log])
    assert [log.name for log in data.logs] == ["mine", "50 g, 5 rad/s"]
