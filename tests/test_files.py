import ctypes
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest

import butterfly as bf
from butterfly import files
from butterfly.errors import InputError
from butterfly.logs.formats import read_log
from butterfly.yaml_files import load_yaml


def test_a_file_appears_whole_and_its_folder_with_it(tmp_path):
    path = tmp_path / "new/folder/a.mat"
    with files.replacing(path) as draft:
        draft.write_text("whole")
        assert not path.exists()
        assert draft.name.startswith(files.DRAFT)
        assert draft.suffix == ".mat"
    assert path.read_text() == "whole"
    assert list(path.parent.iterdir()) == [path]


def test_what_fails_halfway_leaves_the_old_file_and_no_litter(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")

    def fail_halfway():
        with files.replacing(path, internal=True) as draft:
            draft.write_text("ne")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_halfway()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_reader_without_memory_has_not_met_damage(tmp_path):
    with pytest.raises(MemoryError), files.whole(tmp_path / "a.json", "complete JSON"):
        raise MemoryError


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").touch()
    with (
        pytest.raises(InputError, match="a writable file"),
        files.replacing(tmp_path / "file/a") as draft,
    ):
        draft.write_text("x")


_WRITER = """
import sys
from pathlib import Path
from butterfly.files import replacing
for _ in range(100):
    with replacing(Path(sys.argv[1]), internal=True) as draft:
        draft.write_text(sys.argv[2] * 20_000)
"""


def test_two_processes_write_one_path_and_a_reader_meets_whole_files_only(tmp_path):
    path = tmp_path / "a.txt"
    words = [sys.executable, "-c", _WRITER, str(path)]
    writers = [subprocess.Popen([*words, letter]) for letter in "xy"]  # noqa: S603
    met = set()
    while any(writer.poll() is None for writer in writers):
        if path.exists():
            met.add(path.read_text())
        else:
            time.sleep(0.01)
    assert [writer.returncode for writer in writers] == [0, 0]
    assert met <= {"x" * 20_000, "y" * 20_000}
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX permissions")
@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_a_file_has_the_permissions_of_any_new_file(tmp_path, mask):
    before = os.umask(mask)
    try:
        (tmp_path / "plain").write_text("")
        with files.replacing(tmp_path / "ours") as draft:
            draft.write_text("")
    finally:
        os.umask(before)
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize("name", ["quickstart", "quickstart.yaml", "experiments/quickstart.yaml"])
def test_a_shipped_experiment_is_found_by_any_of_its_names_from_anywhere(
    name, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert files.locate(Path(name)) == files.shipped("experiments/quickstart.yaml")
    assert "experiments/quickstart.yaml" in files.shipped_experiments()
    assert files.shipped("models/butterfly_hand/hand.xml").is_file()


def test_a_file_of_the_user_s_own_comes_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("quickstart.yaml").touch()
    assert files.locate(Path("quickstart.yaml")) == Path("quickstart.yaml")


def test_an_unknown_name_is_answered_with_the_known_ones(tmp_path):
    with pytest.raises(InputError, match=r"a shipped file: .*quickstart"):
        files.locate(tmp_path / "nowhere.yaml")


def test_a_misspelt_shipped_file_is_refused_with_the_nearest_name():
    with pytest.raises(InputError, match=r"shipped file: 'quickstart' \(did you mean that\?\)"):
        files.locate(Path("quikstart"))
    with pytest.raises(InputError, match="no such shipped file"):
        files.shipped("models/nowhere.xml")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such files")
@pytest.mark.parametrize("ending", [".csv", ".tsv", ".txt", ".mat", ".parquet", ".yaml"])
@pytest.mark.parametrize("kind", ["pipe", "folder", "device", "none"])
def test_what_is_no_regular_file_is_refused_at_once_whoever_reads(tmp_path, kind, ending):
    path = tmp_path / f"a{ending}"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "device":
        path.symlink_to("/dev/zero")
    said = {"folder": "a folder", "none": "no such file"}.get(kind, "a pipe or a device")
    read = load_yaml if ending == ".yaml" else read_log
    with pytest.raises(InputError, match=f"a{ending}: path: got {said}; expected an existing"):
        read(path)


@pytest.mark.parametrize(
    ("name", "said"), [("a\0.csv", "null characters"), ("x" * 5000, "names of at most 255 bytes")]
)
@pytest.mark.parametrize("ending", [".csv", ".mat", ".parquet", ".yaml"])
def test_a_name_that_no_file_can_have_is_one_line(tmp_path, name, said, ending):
    read = load_yaml if ending == ".yaml" else read_log
    with pytest.raises(InputError, match=said):
        read(tmp_path / f"{name}{ending}")


_AS_NOBODY = (
    *(partial(read_log, Path(path)) for path in ("closed/a.csv", "closed.csv", "closed.mat")),
    partial(read_log, Path("closed.parquet")),
    *(partial(bf.read, path, input="torque") for path in ("closed/a.csv", "closed", "open")),
    partial(bf.read, "closed.yaml"),
    *(
        partial(files.write_file, Path(path), "a")
        for path in ("closed/new.csv", "closed/new/b.csv")
    ),
)


def _as_others():
    """Take from root, in this thread alone, what opens any file."""
    header, sets = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
    libc = ctypes.CDLL(None)
    libc.capget(header, sets)
    sets[0] &= ~0b110  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
    assert libc.capset(header, sets) == 0


def _refusal(act):
    with pytest.raises(InputError) as refused:
        act()
    return str(refused.value)


@pytest.mark.skipif(sys.platform != "linux", reason="root is not taken its rights elsewhere")
def test_files_and_folders_without_permission_are_one_line_each(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    closed = [Path("closed"), Path("open/closed")]
    for folder in closed:
        folder.mkdir(parents=True)
    for ending in ("/a.csv", ".csv", ".mat", ".parquet", ".yaml"):
        path = Path(f"closed{ending}")
        path.write_text("time,input,angle\n" + "1,2,3\n" * 20)
        path.chmod(0)
    for folder in closed:
        folder.chmod(0)
    with ThreadPoolExecutor(1, initializer=_as_others) as thread:
        lines = list(thread.map(_refusal, _AS_NOBODY))
    for folder in closed:
        folder.chmod(0o755)
    assert all("closed" in line and "Permission denied" in line for line in lines), lines
    assert not any("\n" in line for line in lines)
