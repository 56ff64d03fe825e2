"""``python -m butterfly`` is the command line, with its exit codes."""

import subprocess
import sys

import pytest

import butterfly


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("--version",), 0, butterfly.__version__),
        (("inspekt",), 2, 'Unknown command "inspekt". Did you mean "inspect"?'),
    ],
)
def test_the_package_runs_as_the_command_does(tmp_path, words, code, said):
    run = subprocess.run(  # noqa: S603 - its own program
        [sys.executable, "-m", "butterfly", *words],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == code
    assert said in run.stdout + run.stderr
    assert "Traceback" not in run.stderr
