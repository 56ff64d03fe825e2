import ctypes
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from butterfly.errors import InputError
from butterfly.files import DRAFT, locate, replacing, shipped, shipped_experiments
from butterfly.logs.formats import read_log
from butterfly.yaml_files import load_yaml


def test_a_file_appears_whole_and_its_folder_with_it(tmp_path):
    path = tmp_path / "new/folder/a.mat"
    with replacing(path) as draft:
        draft.write_text("whole")
        assert not path.exists()
        assert draft.name.startswith(DRAFT)
        assert draft.suffix == ".mat"
    assert path.read_text() == "whole"
    assert list(path.parent.iterdir()) == [path]


def test_what_fails_halfway_leaves_the_old_file_and_no_litter(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")

    def fail_halfway():
        with replacing(path, own=True) as draft:
            draft.write_text("ne")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_halfway()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").touch()
    with (
        pytest.raises(InputError, match="a writable file"),
        replacing(tmp_path / "file/a") as draft,
    ):
        draft.write_text("x")


_WRITER = """
import sys
from pathlib import Path
from butterfly.files import replacing
for _ in range(100):
    with replacing(Path(sys.argv[1]), own=True) as draft:
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
        with replacing(tmp_path / "ours") as draft:
            draft.write_text("")
    finally:
        os.umask(before)
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize("name", ["quickstart", "quickstart.yaml", "experiments/quickstart.yaml"])
def test_a_shipped_experiment_is_found_by_any_of_its_names_from_anywhere(
    name, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert locate(Path(name)) == shipped("experiments/quickstart.yaml")
    assert "experiments/quickstart.yaml" in shipped_experiments()
    assert shipped("models/butterfly_hand/hand.xml").is_file()


def test_a_file_of_the_user_s_own_comes_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("quickstart.yaml").touch()
    assert locate(Path("quickstart.yaml")) == Path("quickstart.yaml")


def test_an_unknown_name_is_answered_with_the_known_ones(tmp_path):
    with pytest.raises(InputError, match=r"experiments/quickstart\.yaml"):
        locate(tmp_path / "nowhere.yaml")
    with pytest.raises(InputError, match="no such shipped file"):
        shipped("models/nowhere.xml")


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


_AS_NOBODY = """
import butterfly as bf
from pathlib import Path
from butterfly.errors import InputError
from butterfly.logs.formats import read_log
from butterfly.files import write_file
for act in (
    lambda: read_log(Path("closed/a.csv")),
    lambda: read_log(Path("closed.csv")),
    lambda: read_log(Path("closed.mat")),
    lambda: read_log(Path("closed.parquet")),
    lambda: bf.read("closed/a.csv", input="torque"),
    lambda: bf.read("closed.yaml"),
    lambda: bf.read("closed", input="torque"),
    lambda: bf.read("open", input="torque"),
    lambda: write_file(Path("closed/new.csv"), "a"),
    lambda: write_file(Path("closed/new/new.csv"), "a"),
):
    try:
        act()
        print("nothing refused")
    except InputError as error:
        print(error)
"""


def _as_others():
    """Take from root, in a process about to begin, what opens any file."""
    for capability in (1, 2):  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
        ctypes.CDLL(None).prctl(24, capability, 0, 0, 0)  # PR_CAPBSET_DROP


@pytest.mark.skipif(sys.platform != "linux", reason="root is not taken its rights elsewhere")
def test_files_and_folders_without_permission_are_one_line_each():
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        for each in ("closed", "open/closed"):
            (folder / each).mkdir(parents=True)
        names = [f"closed{ending}" for ending in (".csv", ".mat", ".parquet", ".yaml")]
        for each in ("closed/a.csv", *names):
            (folder / each).write_text("time,input,angle\n" + "1,2,3\n" * 20)
            (folder / each).chmod(0)
        for each in ("closed", "open/closed"):
            (folder / each).chmod(0)
        done = subprocess.run(  # noqa: S603
            [sys.executable, "-c", _AS_NOBODY],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
            preexec_fn=_as_others,
        )
        for each in ("closed", "open/closed"):
            (folder / each).chmod(0o755)
    lines = done.stdout.splitlines()
    assert done.returncode == 0, done.stderr
    assert len(lines) == 10
    assert all("closed" in line and "Permission denied" in line for line in lines), lines
