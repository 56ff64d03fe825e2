"""Compile what the tests need of numba's kernels, once, before their workers start.

python -m tests.kernels prints the folder of the cache, for NUMBA_CACHE_DIR. It is named by the
sources of whatever is compiled and by the versions of Python, NumPy and numba; others go.
"""

import hashlib
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).parents[1]
KEPT = ROOT / "build" / "kernels"


def main():
    """Print the folder, filled."""
    folder = KEPT / key()
    done = folder / "done"
    stamp = "\n".join(f"{path} {path.stat().st_mtime_ns}" for path in _sources())
    if not done.exists() or done.read_text() != stamp:
        for other in KEPT.glob("*"):
            if other != folder:
                shutil.rmtree(other)
        own = os.environ | {"NUMBA_CACHE_DIR": str(folder), "PYTHONPATH": str(ROOT)}
        code = "from tests.kernels import rehearse_all; rehearse_all()"
        subprocess.run([sys.executable, "-c", code], env=own, cwd=ROOT, check=True)  # noqa: S603
        done.write_text(stamp)
    print(folder)


def key() -> str:
    """Return a name for what the sources are compiled to."""
    digest = hashlib.sha256(sys.version.encode())
    for package in ("numba", "numpy"):
        digest.update(version(package).encode())
    for path in _sources():
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _sources() -> list[Path]:
    """Return the files of the package that numba compiles functions of, and what tells it how."""
    paths = sorted((ROOT / "butterfly").rglob("*.py"))
    own = "from butterfly.compiled import", "def compiled("
    return [path for path in paths if any(each in path.read_text("utf-8") for each in own)]


def rehearse_all() -> None:
    """Call the kernels with all kinds of arguments that tests call them with."""
    import numpy as np  # noqa: PLC0415 - nothing is imported where nothing is to be compiled

    from butterfly.identification.simulation import Simulation, rehearse  # noqa: PLC0415
    from butterfly.logs.log import Log  # noqa: PLC0415
    from butterfly.model.parameters import LumpedParameters  # noqa: PLC0415
    from butterfly.model.servo import ServoLoop  # noqa: PLC0415
    from butterfly.signals import hold  # noqa: PLC0415

    rehearse()
    time = np.arange(0.0, 0.2, 0.01)
    fixed = LumpedParameters(p1=1.0, p2=1.0, p3=1.0, p4=1.0)
    moving = replace(fixed, base_compliance=1e-3, base_frequency=30.0)
    opened = Log(time, time, time)
    closed = Log(time, time, time, servo=ServoLoop(law="pid-torque"), setpoint=time)
    for robot in (fixed, moving):
        for log in (opened, closed):
            simulation = Simulation(log, robot)
            simulation.run(robot, 0.0)
            simulation.linearised(("p1",), robot, 0.0)
    hold.for_sums(time, time, time, opened.intersample)


if __name__ == "__main__":
    main()
