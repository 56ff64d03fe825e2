"""Logs that pages show and that are not shipped."""

import os
import shutil
from pathlib import Path

import pytest

_SHARED = Path(__file__).parents[3] / "shared/data/strangers"


@pytest.fixture
def strangers(tmp_path, monkeypatch):
    """Puts the logs of a robot into a folder where the program then runs."""

    def copied(robot, name):
        source = Path(os.environ.get("BUTTERFLY_STRANGERS") or _SHARED) / robot
        if not source.is_dir():
            pytest.skip(f"logs are not there: no folder {source} (BUTTERFLY_STRANGERS)")
        folder = tmp_path / name
        folder.mkdir()
        for path in source.glob("*.csv"):
            shutil.copyfile(path, folder / path.name)
        monkeypatch.chdir(tmp_path)
        return folder

    return copied
