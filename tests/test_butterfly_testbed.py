"""Where another package has the name butterfly, a line says so."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import butterfly
from butterfly import __version__

ROOT = Path(butterfly.__file__).parents[1]


def _run(*folders):
    """Run the command with folders of packages before all others."""
    path = os.pathsep.join(map(str, [*folders, ROOT]))
    call = "import sys; sys.argv[1:] = ['--version']; from butterfly_testbed import main; main()"
    ended = subprocess.run(  # noqa: S603 - our own
        [sys.executable, "-P", "-c", call],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    return ended.returncode, ended.stdout, ended.stderr


@pytest.fixture
def terminal(tmp_path):
    """The metadata of a package named butterfly, without its files."""
    (tmp_path / "butterfly-3.2.5.dist-info").mkdir()
    about = "Metadata-Version: 2.1\nName: butterfly\nVersion: 3.2.5\n"
    (tmp_path / "butterfly-3.2.5.dist-info/METADATA").write_text(about)
    return tmp_path


def test_alone_it_is_the_command():
    assert _run() == (0, f"butterfly {__version__}\n", "")


def test_beside_the_other_package_it_warns(terminal):
    code, out, err = _run(terminal)
    assert (code, out) == (0, f"butterfly {__version__}\n")
    assert err.startswith("warning: butterfly 3.2.5 is another package with the same files: pip")
    assert err.count("\n") == 1


@pytest.mark.parametrize("named", [True, False])
def test_below_the_other_package_it_says_so_and_ends(terminal, named, tmp_path):
    (tmp_path / "butterfly").mkdir()
    (tmp_path / "butterfly/__init__.py").write_text("")
    if not named:
        (terminal / "butterfly-3.2.5.dist-info/METADATA").unlink()
        (terminal / "butterfly-3.2.5.dist-info").rmdir()
    code, out, err = _run(terminal)
    assert (code, out) == (2, "")
    assert err.startswith("error: butterfly-testbed is not whole: ")
    assert ("butterfly 3.2.5" in err) == named
    assert err.count("\n") == 1
