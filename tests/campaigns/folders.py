"""Folders of campaigns that the tests write and go on with."""

import json
import os
import socket

import numpy as np
import pytest

from butterfly.campaigns import folder as module
from butterfly.campaigns.bench import Contact, Recording
from butterfly.campaigns.folder import Folder, Journal, Step
from butterfly.campaigns.lock import LOCK
from butterfly.errors import InputError
from butterfly.logs.log import InputKind
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass

MASS = AddedMass(mass=0.1, arm=0.1)
OURS = {"campaign.json", "manifest.yaml", "run_000.parquet", "run_001.parquet"}


def recording(number):
    """Return what a run recorded, each something else."""
    time = 0.01 * np.arange(400)
    return Recording(time, np.sin(3 * time), np.sin(time + number), "", InputKind.TORQUE)


def step(number, verdict=""):
    """Return the entry of a run, every other one with a mass."""
    mass = (NO_ADDED_MASS, MASS)[number % 2]
    return Step(
        what=f"run {number}", why="", added_mass=mass, seconds=number + 1.0, verdict=verdict
    )


def record(path, runs, known=None):
    """Go on with a campaign until it has this many runs; returns the folder's notes."""
    with Folder(path) as folder:
        journal = Journal(input_kind=InputKind.TORQUE, contact=Contact(1, 0.1))
        journal = folder.journal if folder.is_begun else journal
        folder.begin(module.replace(journal, known=journal.known | (known or {})))
        for number in range(len(folder.journal.steps), runs):
            folder.add(recording(number), step(number))
            folder.conclude(step(number, "good"))
        return folder.notes


def contents(path):
    """Bytes of each file, and where links lead."""
    return {
        str(each.relative_to(path)): each.readlink() if each.is_symlink() else each.read_bytes()
        for each in path.rglob("*")
        if each.is_symlink() or each.is_file()
    }


def refused(path, match, runs=3):
    """Whether going on is refused in these words, with nothing changed."""
    before = contents(path)
    with pytest.raises(InputError, match=match):
        record(path, runs)
    assert contents(path) == before


def stale(path, **differing):
    """Leave the lock of a process that is gone."""
    here = {"host": socket.gethostname(), "process": os.getpid(), "started": 1}
    (path / LOCK).write_text(json.dumps(here | differing), encoding="utf-8")
