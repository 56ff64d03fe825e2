import os
import subprocess
import sys
from pathlib import Path

import pytest

import butterfly

SOURCES = {
    "inner": """
from butterfly.compiled import compiled

FACTOR = 2.0

@compiled
def scaled(x):
    return FACTOR * x
""",
    "middle": """
from butterfly.compiled import inlined
from small.inner import scaled

@inlined
def shifted(x):
    return scaled(x) + 1.0
""",
    "outer": """
from butterfly.compiled import compiled
from small.inner import FACTOR
from small.middle import shifted

@compiled
def total(x):
    return below(x) + FACTOR

@compiled
def below(x):
    return shifted(x)
""",
}
CALL = """
from small.outer import total
print(total(10.0), sum(total.stats.cache_hits.values()))
"""


@pytest.fixture
def small(tmp_path):
    package = tmp_path / "small"
    package.mkdir()
    (package / "__init__.py").touch()
    for name, source in SOURCES.items():
        (package / f"{name}.py").write_text(source)
    return package


def _start(package):
    """Return what a new process finds, and how much of it was compiled before."""
    paths = [package.parent, Path(butterfly.__file__).parents[1]]
    own = {"PYTHONPATH": os.pathsep.join(map(str, paths)), "PYTHONDONTWRITEBYTECODE": "1"}
    own["NUMBA_CACHE_DIR"] = str(package.parent / "cache")
    done = subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, "-c", CALL],
        env=os.environ | own,
        capture_output=True,
        text=True,
        check=True,
    )
    found, hits = done.stdout.split()
    return float(found), int(hits)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "before", "after", "expected"),
    [
        ("inner", "FACTOR * x", "FACTOR * x * x", 203.0),
        ("inner", "FACTOR = 2.0", "FACTOR = 3.0", 34.0),
        ("middle", "+ 1.0", "- 1.0", 21.0),
    ],
)
def test_a_change_in_a_file_that_is_called_is_noticed_at_the_next_start(
    small, file, before, after, expected
):
    assert _start(small) == (23.0, 0)
    assert _start(small) == (23.0, 1)
    source = (small / f"{file}.py").read_text()
    (small / f"{file}.py").write_text(source.replace(before, after))
    assert _start(small) == (expected, 0)


ALONE = """
import numba
from numba.core import event
from butterfly.compiled import compiled, inner

@inner
def power(x, times):
    return x**times

@compiled
def total(x):
    return power(x, 2) + power(x, 3)

class Count(event.Listener):
    names = []
    def on_start(self, event):
        self.names.append(event.data["dispatcher"].py_func.__name__)
    def on_end(self, event):
        pass

event.register("numba:compile", Count())
print(total(2.0), Count.names.count("power"), power(2.0, 4))
"""


def test_what_only_kernels_call_is_compiled_once_for_all_constants_and_runs_in_python(tmp_path):
    source = tmp_path / "alone.py"
    source.write_text(ALONE)
    command = [sys.executable, str(source)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603 - our own
    assert done.stdout.split() == ["12.0", "1", "16.0"]
