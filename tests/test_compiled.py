import os
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core.registry import CPUDispatcher

import butterfly
from butterfly.logs.log import Intersample
from butterfly.signals import hold
from tests.conftest import brief_quickstart
from tests.programs import said

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


def _start(package, code=CALL, cache="cache"):
    """Return what a new process prints, what it compiles being kept beside the package."""
    paths = [package.parent, Path(butterfly.__file__).parents[1]]
    own = {"PYTHONPATH": os.pathsep.join(map(str, paths)), "PYTHONDONTWRITEBYTECODE": "1"}
    if cache is not None:
        own["NUMBA_CACHE_DIR"] = str(package.parent / cache)
    return said(sys.executable, "-c", code, env=os.environ | own)


@pytest.mark.slow
def test_a_change_in_a_file_that_is_called_is_noticed_at_the_next_start(small):
    assert _start(small) == "23.0 0\n"
    assert _start(small) == "23.0 1\n"
    for file, before, after, expected in (
        ("inner", "FACTOR * x", "FACTOR * x * x", 203.0),
        ("inner", "FACTOR = 2.0", "FACTOR = 3.0", 34.0),
        ("middle", "+ 1.0", "- 1.0", 21.0),
    ):
        (small / f"{file}.py").write_text(SOURCES[file].replace(before, after))
        assert _start(small) == f"{expected} 0\n"
        (small / f"{file}.py").write_text(SOURCES[file])


WATCHED = """
from butterfly import progress
from numba.core import event

progress.tell = print

class Watch(event.Listener):
    def on_start(self, event):
        print(event.data["dispatcher"].py_func.__name__)
    def on_end(self, event):
        pass
"""
BESIDE = f"""
{WATCHED}
from butterfly.compiled import compiling_beside
from small.outer import rehearse, total

with compiling_beside(rehearse):
    event.register("numba:compile", Watch())
print(total(10.0), sum(total.stats.cache_hits.values()))
"""


@pytest.mark.slow
def test_another_process_compiles_what_is_not_on_disk_and_that_is_said(small):
    with (small / "outer.py").open("a") as outer:
        outer.write("\ndef rehearse():\n    total(1.0)\n")
    assert _start(small, BESIDE) == "Compiling (once after installation)\n23.0 1\n"
    assert _start(small, BESIDE) == "23.0 1\n"


REHEARSED = """
import sys
from numba.core.registry import CPUDispatcher
from butterfly.experiment.run import data_set_of, simulate
from butterfly.experiment.source import read_experiment
from butterfly.identification.identify import identify
from butterfly.identification.simulation import rehearse

def compiled():
    modules = [each for name, each in sys.modules.items() if name.startswith("butterfly.")]
    made = [each for module in modules for each in vars(module).values()]
    return {each.__name__: len(each.signatures) for each in made if type(each) is CPUDispatcher}

experiment = read_experiment("PATH")
logs = list(simulate(experiment))
before = compiled()
rehearse()
rehearsed = compiled()
identify(data_set_of(experiment, logs))
print(sorted(name for name in compiled() if compiled()[name] != rehearsed[name]))
print(rehearsed["differentiate"] - before["differentiate"])
"""


def test_what_is_rehearsed_is_all_that_an_identification_calls(tmp_path):
    code = REHEARSED.replace("PATH", str(brief_quickstart(tmp_path, "grey-box", few=2)))
    assert _start(Path(__file__).parent, code, cache=None) == "[]\n1\n"


ALONE = f"""
{WATCHED}
from butterfly.compiled import compiled, inner

event.register("numba:compile", Watch())

@inner
def power(x, times):
    return x**times

@compiled
def total(x):
    return power(x, 2) + power(x, 3)

print(total(2.0), power(2.0, 4))
"""


def test_what_only_kernels_call_is_compiled_once_for_all_constants_and_runs_in_python(small):
    (small / "alone.py").write_text(ALONE)
    lines = _start(small, "import small.alone").split("\n")
    assert lines == ["Compiling (once after installation)", "total", "power", "12.0 16.0", ""]


def _layouts(numbers):
    """The same numbers as other programs leave them in memory."""
    strided, guarded = np.repeat(numbers, 2)[::2], numbers.copy()
    guarded.flags.writeable = False
    return numbers, strided, guarded


def test_what_is_read_from_anywhere_is_compiled_once():
    time = np.arange(0.0, 0.2, 0.01)
    for stamps in _layouts(time):
        for values in _layouts(np.sin(40 * time)):
            hold.mean(stamps, values, time, Intersample.ZERO_ORDER_HOLD)
            hold.parabolas(stamps, values, time, Intersample.ZERO_ORDER_HOLD)
            hold.for_sums(stamps, values, time, Intersample.ZERO_ORDER_HOLD)
            hold.averages(time, stamps, values, slopes=False)
            hold.interpolate(time, values, values, stamps, slopes=False)
    kernels = (vars(module).values() for module in (hold, hold))
    for kernel in (each for values in kernels for each in values if type(each) is CPUDispatcher):
        assert len(kernel.signatures) <= 1, kernel
