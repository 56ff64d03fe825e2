"""Watch a run while it is simulated, in MuJoCo's viewer or in a browser."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator

import mujoco
import numpy as np

from butterfly.model.parameters import AddedMass
from butterfly.plant import has_display
from butterfly.plant.joints import MujocoJoint
from butterfly.plant.mjcf import compile_model
from butterfly.plant.motor import Sample
from butterfly.plant.rig import Rig
from butterfly.plant.watch.picture import RenderingError
from butterfly.signals.excitations import Excitation

_PAUSE = 0.5  # s by which the simulation may lag before it stops trying to catch up
_BUSY = 0.02  # s on the wall clock that one frame may spend on simulating
_FRAME = 0.01  # s of rest between two frames


class LiveRun:
    """One run of a rig, sample by sample, in a MuJoCo model that a viewer can show.

    Its samples are those of the run's log before the rig's faults. After the last, or when a viewer
    resets the state, it restarts with the same seed. A MuJoCo joint is the ``model`` with its
    ``data``, so it can be pulled in the viewer; the grey box is only drawn.
    """

    def __init__(
        self,
        rig: Rig,
        added: AddedMass,
        excitation: Excitation,
        duration: float,
        seed: np.random.SeedSequence,
    ) -> None:
        self._rig, self._signal, self._duration = rig, excitation.sample, duration
        self._seed = seed
        self._joint = rig.joint(added, *rig.start(added, excitation), scene=True)
        if isinstance(self._joint, MujocoJoint):
            self.model, self.data = self._joint.model, self._joint.data
        else:
            self.model = compile_model(rig.robot, added, scene=True)
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
        """Advance to the next sample."""
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
        with self._rig.loop(self._joint, np.random.default_rng(self._seed)) as loop:
            yield from loop.samples(self._signal, self._duration)

    def _show(self) -> None:
        if not isinstance(self._joint, MujocoJoint):
            hinge = self.data.joint("hinge")
            hinge.qpos[0], hinge.qvel[0] = self._joint.angle, self._joint.velocity
            self.data.time = self.sample[0]
            mujoco.mj_forward(self.model, self.data)
        self._left = self.data.time


class RealTime:
    """Steps a run in real time; the clock returns the time in s."""

    def __init__(self, run: LiveRun, clock: Callable[[], float] = time.monotonic) -> None:
        self._run, self._clock = run, clock
        self._origin = -math.inf

    def catch_up(self) -> None:
        """Step up to now, for at most 20 ms of real time or a single sample.

        More than half a second late (a pause, a slow machine), it continues without catching up.
        """
        now = self._clock()
        if not abs(now - self._origin - self._run.elapsed) < _PAUSE:
            self._origin = now - self._run.elapsed
        end = now + _BUSY
        while self._run.elapsed < now - self._origin and now < end:
            self._run.advance()
            now = self._clock()


def watch(run: LiveRun, *, web: bool = False, port: int = 0) -> None:
    """Show a run in real time, until the viewer is closed or Ctrl-C is pressed."""
    pace = RealTime(run)
    if web:
        from butterfly.plant.watch import browser  # noqa: PLC0415 - slow to import, seldom wanted

        def advance() -> None:
            time.sleep(_FRAME)
            pace.catch_up()

        browser.serve(run.model, run.data, advance, port)
        return
    if not has_display():
        raise RenderingError("no display for a viewer: use --web, or butterfly show --out FILM")
    from mujoco import viewer  # noqa: PLC0415 - needs the window system when it is imported

    with viewer.launch_passive(run.model, run.data) as handle:
        while handle.is_running():
            time.sleep(_FRAME)
            with handle.lock():
                pace.catch_up()
            handle.sync()
