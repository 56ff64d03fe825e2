"""Data that several tests share."""

import gc
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, settings

import butterfly.plant
from butterfly import progress
from butterfly.api.verbs import identify
from butterfly.cli import main, output
from butterfly.experiment.run import simulate, write_logs
from butterfly.experiment.source import read_experiment
from butterfly.files import shipped
from butterfly.identification.data import read_data_set
from butterfly.logs.log import Intersample, Log, Sine
from butterfly.logs.manifest import read_manifest
from butterfly.logs.thesis_logs import found_folder
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.thesis import method
from butterfly.twin.twin import Yardstick

# Compilation and file systems make the first example slow. The draws are the same every time, so
# that a change fails only by what it changes; `pytest --hypothesis-profile explore` draws anew.
_HOW = {"deadline": None, "suppress_health_check": [HealthCheck.function_scoped_fixture]}
settings.register_profile("project", **_HOW, database=None, derandomize=True)
settings.register_profile("explore", **_HOW, database=None, max_examples=1_000)
settings.load_profile("project")

_CHECKOUT = Path(__file__).parents[1]

ROBOT = LumpedParameters(p1=0.00325, p2=0.00145, p3=0.04905, p4=0.025, coulomb=3e-4, delay=0.002)
MASSES = (AddedMass(), AddedMass(mass=0.05, arm=0.104), AddedMass(mass=0.12, arm=0.104))


def pytest_collection_finish():
    gc.freeze()  # what is imported by now is not looked through again and again


@pytest.fixture(scope="session")
def logs_folder() -> Path:
    """The thesis's 41 logs, wherever they are."""
    folder = found_folder() or _CHECKOUT.parent / "shared/data/butterfly_logs"
    if not folder.is_dir():
        pytest.skip(f"the real logs are not there: no folder {folder} (`butterfly fetch`)")
    return folder


@pytest.fixture(scope="session")
def real_manifest(logs_folder):
    return read_manifest(shipped("experiments/real-logs.yaml"), logs_folder)


@pytest.fixture(scope="session")
def real_data(real_manifest):
    return read_data_set(real_manifest)


@pytest.fixture(scope="session")
def real(real_data):
    """The default identification of the real logs."""
    return identify(real_data)


@pytest.fixture
def sine_log() -> Log:
    """A healthy 40 s log at 1 kHz of a joint that follows 5 rad/s with some lag."""
    time = np.arange(40_000) * 1e-3
    swing = {"angle": 0.1 * np.sin(5 * time - 0.4), "velocity": 0.5 * np.cos(5 * time - 0.4)}
    about = {"excitation": Sine(omega=5.0, amplitude=0.2), "added_mass": MASSES[1]}
    about |= {"intersample": Intersample.FIRST_ORDER_HOLD, "source": "sine"}
    return Log(time, 0.2 * np.sin(5 * time), **swing, **about)


@pytest.fixture
def butterfly(monkeypatch, capsys):
    """Run the command line; returns exit code, stdout and stderr, however slow the machine is."""
    monkeypatch.setattr(output, "note", progress.tell)  # wherever it is the first to compile

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["butterfly", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        captured = capsys.readouterr()
        return ended.value.code or 0, captured.out, captured.err

    return run


def brief_quickstart(folder, simulator, few=3, every=3):
    """Write the quick start on as few sines and masses, short but steady enough to fit."""
    content = yaml.safe_load(shipped("experiments/quickstart.yaml").read_text())
    content.update(duration=12.0, excitations=content["excitations"][::every][:few])
    content["added_masses"] = content["added_masses"][:few]
    content["plant"] |= {"simulator": simulator, "run_in": 0.0}
    content["plant"]["clock"]["step"] = 0.005
    path = folder / "quick.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.fixture
def quick(tmp_path):
    """The quick start on fewer logs, by the fast simulator."""
    return brief_quickstart(tmp_path, "grey-box")


@pytest.fixture
def quick_in_mujoco(tmp_path):
    """The quick start on four logs in MuJoCo, as it is shipped."""
    return brief_quickstart(tmp_path, "mujoco", few=2)


@pytest.fixture(scope="session")
def quick_data(tmp_path_factory):
    """The data set of `quick`, as `butterfly simulate` writes it; only to be read."""
    folder = tmp_path_factory.mktemp("quick")
    experiment = read_experiment(brief_quickstart(folder, "grey-box"))
    return write_logs(experiment, simulate(experiment), folder / "data").parent


@pytest.fixture(scope="session")
def by_thesis(quick_data):
    """An identification by a method without a covariance, which does not estimate all."""
    data = read_data_set(read_manifest(quick_data / "manifest.yaml"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(method, "_STARTS", (0.3,))
        return identify(data.take([0, 2, 3, 5, 6, 8]), "thesis")


@pytest.fixture
def brief_twins(monkeypatch):
    """Have an exported twin measured on the beginning of one log, where nobody asks how exactly."""
    whole = Yardstick.of

    def of(twin, step):
        (log, setting), *_ = twin.recorded()
        brief = [(log.piece(0, min(400, log.time.size)), setting)]
        return whole(replace(twin, recorded=lambda: brief), step)

    monkeypatch.setattr(Yardstick, "of", of)
