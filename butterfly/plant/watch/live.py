"""A run that is watched while it is simulated, at the pace of the clock on the wall."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator

import mujoco
import numpy as np

from butterfly.model.parameters import AddedMass
from butterfly.plant.bench import Sample
from butterfly.plant.excitations import Excitation, initial_angle
from butterfly.plant.joints import MujocoJoint
from butterfly.plant.mjcf import compile_model
from butterfly.plant.setup import Setup

_PAUSE = 0.5  # s by which the simulation may lag before it stops trying to catch up
_BUSY = 0.02  # s on the wall clock that one frame may spend on simulating


class LiveRun:
    """One run of a setup, sample by sample, in a MuJoCo model that a viewer can show.

    Its samples are those of the run's log, before the setup's faults befall them. After the last it
    starts again, with the same seed; so it does when a viewer resets the state.

    Parameters
    ----------
    setup, added, excitation
        What is run.
    duration
        Of the run in s.
    seed
        Of everything random in it.

    Attributes
    ----------
    model, data
        What a viewer shows. MuJoCo's joint is this model, so that a hand that is pulled in the
        viewer gives way; the grey box is only drawn in it.
    sample
        The latest.
    """

    def __init__(
        self,
        setup: Setup,
        added: AddedMass,
        excitation: Excitation,
        duration: float,
        seed: np.random.SeedSequence,
    ) -> None:
        self._setup, self._signal, self._duration = setup, excitation.sample, duration
        self._seed = seed
        self._joint = setup.joint(added, initial_angle(excitation), scene=True)
        if isinstance(self._joint, MujocoJoint):
            self.model, self.data = self._joint.model, self._joint.data
        else:
            self.model = compile_model(setup.robot, added, scene=True)
            self.data = mujoco.MjData(self.model)
        self._before = 0.0  # s of earlier rounds
        self._left = 0.0  # MuJoCo's time when it was last left alone
        self.sample: Sample = (0.0, 0.0, 0.0)
        self._start()

    @property
    def elapsed(self) -> float:
        """Simulated time in s since the first sample, over all rounds."""
        return self._before + self.sample[0]

    def advance(self) -> None:
        """Go on to the next sample."""
        following = None if self.data.time != self._left else next(self._samples, None)
        if following is None:
            self._before = self.elapsed
            self._start()
            return
        self.sample = following
        self._show()

    def _start(self) -> None:
        self._samples = self._play()
        self.sample = next(self._samples)
        self._show()

    def _play(self) -> Iterator[Sample]:
        with self._setup.bench_of(self._joint, np.random.default_rng(self._seed)) as bench:
            yield from bench.samples(self._signal, self._duration)

    def _show(self) -> None:
        if not isinstance(self._joint, MujocoJoint):
            self.data.qpos[0], self.data.qvel[0] = self._joint.angle, self._joint.velocity
            self.data.time = self.sample[0]
            mujoco.mj_forward(self.model, self.data)
        self._left = self.data.time


class RealTime:
    """Steps a run as fast as the clock on the wall runs.

    Parameters
    ----------
    run
        What is stepped.
    clock
        Tells the time in s.
    """

    def __init__(self, run: LiveRun, clock: Callable[[], float] = time.monotonic) -> None:
        self._run, self._clock = run, clock
        self._origin = -math.inf

    def catch_up(self) -> None:
        """Step up to now, for 20 ms on the wall clock or a single sample at most.

        A machine too slow for real time shows slow motion: whoever is half a second late, after a
        pause too, goes on from where he is.
        """
        now = self._clock()
        if not abs(now - self._origin - self._run.elapsed) < _PAUSE:
            self._origin = now - self._run.elapsed
        end = now + _BUSY
        while self._run.elapsed < now - self._origin and now < end:
            self._run.advance()
            now = self._clock()
