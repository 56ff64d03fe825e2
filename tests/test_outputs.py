"""What may be written over: what nobody reads, of the same kind, or what that was asked for."""

import pytest

from butterfly.errors import InputError
from butterfly.outputs import (
    call,
    mark_of,
    mark_of_document,
    note_input,
    require_endings,
    require_free,
)

ENDINGS = [".html", ".svg", ".png", ".xml", ".urdf", ".parquet"]


def written(folder, name, content=""):
    """Write a text to a file of a folder, and return its path."""
    path = folder / name
    path.write_text(content)
    return path


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("before", [0, 3000, 500_000])
def test_a_file_is_replaced_by_its_own_kind_alone_wherever_the_mark_stands(
    tmp_path, ending, before
):
    path = tmp_path / f"a{ending}"
    mark, other = mark_of(path, "campaign"), mark_of(path, "inspection")
    written(tmp_path, path.name, before * "x" + mark)
    require_free(path, mark)
    require_free(path, other, mark)
    require_free(path, mark_of(path))  # how the mark of any kind begins
    with pytest.raises(InputError, match="path: got an existing file of another kind"):
        require_free(path, other)


def test_a_document_is_known_by_its_schema(tmp_path):
    path = written(tmp_path, "a.json", '{"schema": "butterfly.sweep",\n "schema_number": 1}')
    require_free(path, mark_of_document("sweep"))
    with pytest.raises(InputError, match="another kind"):
        require_free(path, mark_of_document("sweep", "runs"))


def test_what_holds_no_mark_is_replaced_if_that_is_asked_for(tmp_path):
    path, page = written(tmp_path, "a.csv"), written(tmp_path, "a.html")
    assert mark_of(path, "log") == ""
    with call(overwrite=True):
        require_free(path)
        with pytest.raises(InputError, match="another kind"):
            require_free(page, mark_of(page, "log"))
    with pytest.raises(InputError, match=r"--json: got an existing file; .*--overwrite"):
        require_free(path, option="--json")


def test_what_is_read_is_not_written_by_any_of_its_names_until_the_call_has_ended(tmp_path):
    path, other = written(tmp_path, "a.csv"), tmp_path / "b.csv"
    other.hardlink_to(path)
    with call(overwrite=True):
        with call():  # adds to what the outer one reads
            note_input(path)
        for name in (path, other, tmp_path / "." / "a.csv"):
            with pytest.raises(InputError, match="got a file that is read here"):
                require_free(name)
    with call(overwrite=True):
        require_free(path)


def test_a_folder_of_results_is_the_programs_own_with_all_that_is_below_it(tmp_path):
    (tmp_path / "results/runs").mkdir(parents=True)
    inside, beside = written(tmp_path, "results/runs/a.csv"), written(tmp_path, "a.csv")
    with call(folder=tmp_path / "results"):
        require_free(inside)
        with pytest.raises(InputError, match="an existing file"):
            require_free(beside)


def test_links_and_folders_are_refused_even_if_overwriting_is_asked_for(tmp_path):
    (tmp_path / "gone.csv").symlink_to(tmp_path / "nowhere")
    (tmp_path / "folder.csv").mkdir()
    with call(overwrite=True):
        require_free(tmp_path / "new.csv")
        for name, said in (("gone.csv", "a link"), ("folder.csv", "a folder")):
            with pytest.raises(InputError, match=f"{name}: path: got {said}"):
                require_free(tmp_path / name)


def test_an_ending_is_one_of_those_that_are_known_in_any_case(tmp_path):
    require_endings(tmp_path / "a.XML", (".xml", ".urdf"))
    with pytest.raises(InputError, match=r"--to: got \.c; expected \.xml, \.urdf or \.h$"):
        require_endings(tmp_path / "a.c", (".xml", ".urdf", ".h"), "--to")
    with pytest.raises(InputError, match=r"path: got no ending; expected \.xml$"):
        require_endings(tmp_path / "a", (".xml",))
