"""Data whose identification is not to be used, for tests of what is then said."""

import shutil
from pathlib import Path

import pytest
import yaml

from butterfly.identification import physical

_EXCHANGED = {0.0: 0.12, 0.05: 0.05, 0.12: 0.0}  # kg


def impossible_data(good: Path, folder: Path) -> Path:
    """Copy a data set with its lightest and heaviest masses exchanged: p1 comes out negative."""
    shutil.copytree(good, folder)
    path = folder / "manifest.yaml"
    content = yaml.safe_load(path.read_text())
    for entry in content["logs"]:
        entry["added_mass"] = _EXCHANGED[entry["added_mass"]]
    path.write_text(yaml.safe_dump(content | {"root": "."}))
    return folder


def follow_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have no FIT be good enough, so that no estimate may be used, however good."""
    monkeypatch.setattr(physical, "LEAST_FIT", 100.0)
