"""The random streams of an experiment's seed: none is drawn from twice."""

from __future__ import annotations

import numpy as np

_ORBIT = 2**32 - 1  # a number that no run has


def of_runs(seed: int, count: int) -> list[np.random.SeedSequence]:
    """Return the streams of the simulated runs, in order."""
    return np.random.SeedSequence(seed).spawn(count)


def of_orbit(seed: int) -> np.random.SeedSequence:
    """Return the stream of the orbit that is held."""
    return np.random.SeedSequence(seed, spawn_key=(_ORBIT,))
