"""A motor over the independent integrator, in simulated time: it shares no code with the program's.

The drive saturates, rounds and delays a command; the encoder adds noise and rounds to its counts.
Faults take the place of its methods; what they do, they do with `drive`, `sense` and `advance`.
"""

import math
import random
from collections import deque

import numba

from butterfly.logs.log import InputKind
from butterfly.plant.motor import Reading
from tests.independent.integrator import Joint, advance

STEP = 0.5e-3
"""Longest step of the integrator in s."""

GRAVITY = 9.81
STICTION_SPEED = 0.01
"""In rad/s, by which static friction has fallen to a third of its excess."""

_STOP_STIFFNESS = 40.0  # N m/rad of an end stop
_STOP_DAMPING = 0.05  # N m s/rad, so that it does not bounce for ever


@numba.njit(cache=True)
def held(joint, state, torque, duration):
    """Return angle and velocity after a torque was held for some s."""
    angle, velocity = state
    count = max(1, math.ceil(duration / STEP - 1e-9))
    whole = (angle, velocity, 0.0, 0.0)
    for _ in range(count):
        whole = advance(joint, whole, (torque, 1.0), duration / count)
    return whole[0], whole[1]


def under_mass(joint, mass, arm):
    """Return a joint that carries a point mass in kg at some m from its pivot."""
    return joint._replace(
        inertia=joint.inertia + mass * arm**2, gravity=joint.gravity + GRAVITY * mass * arm
    )


class IndependentMotor:
    """A joint with drive and encoder, both polarities; the protocol `Motor`, all methods sound."""

    input_kind = InputKind.TORQUE

    def __init__(
        self,
        joint: Joint,
        *,
        limit: float,
        counts: int = 8192,
        noise: float = 0.0,  # rad, before rounding
        resolution: float = 0.0,  # of the command
        delay: float = 0.0,  # s
        resets: bool = False,  # whether `start` puts the joint back to rest at 0
        polarity: int = 1,
        angle: float = 0.0,  # rad, in the beginning
        seed: int = 0,
    ) -> None:
        self.truth = self.bare = self.joint = joint
        self.limit, self.delay, self.polarity, self.resets = limit, delay, polarity, resets
        self.count, self.noise, self._resolution = math.tau / counts, noise, resolution
        self._random = random.Random(seed)  # noqa: S311 - noise
        self._arriving: deque[tuple[float, float]] = deque()
        self.angle, self.velocity, self.applied = angle, 0.0, 0.0
        self.clock, self.started, self.enabled = 0.0, 0.0, False
        """Simulated time in s, that of the last `start`, and whether the drive is on."""
        self.push, self.end_stop = 0.0, math.inf
        """A torque from outside in N m; an angle in rad that the joint cannot pass."""

    def begin(self):
        """Switch the drive on with command 0, its clock at 0."""
        self._arriving.clear()
        self.applied, self.started, self.enabled = 0.0, self.clock, True
        if self.resets:
            self.angle = self.velocity = 0.0

    def release(self):
        """Switch the drive off."""
        self._arriving.clear()
        self.applied, self.enabled = 0.0, False

    def drive(self, value):
        """Let a command take effect after the delay; return it as set."""
        if self._resolution:
            value = self._resolution * round(value / self._resolution)
        value = max(-self.limit, min(self.limit, value))
        if self.delay:
            self._arriving.append((self.clock + self.delay, value))
        else:
            self.applied = value
        return value

    def sense(self):
        """Return what a sound encoder and clock read now."""
        angle = self.angle + (self._random.gauss(0.0, self.noise) if self.noise else 0.0)
        return Reading(self.clock - self.started, self.count * round(angle / self.count), math.nan)

    def advance(self, duration):
        """Let the joint move for some s, delayed commands taking effect at their own instants."""
        end = self.clock + duration
        while self._arriving and self._arriving[0][0] < end:
            instant, value = self._arriving.popleft()
            self._move(max(instant - self.clock, 0.0))
            self.applied = value
        self._move(end - self.clock)
        self.clock = end

    def _move(self, duration):
        if duration <= 0.0:
            return
        joint = self.joint
        if abs(self.angle) > self.end_stop:
            joint = joint._replace(
                spring=_STOP_STIFFNESS,
                spring_rest=math.copysign(self.end_stop, self.angle),
                viscous=joint.viscous + _STOP_DAMPING,
            )
        torque = joint.gain * self.polarity * self.applied * self.enabled + self.push
        self.angle, self.velocity = held(joint, (self.angle, self.velocity), torque, duration)
        self.clock += duration

    def carry(self, mass):
        """Mount a mass and let the joint hang: at rest, as far from below as friction holds it."""
        self.joint = joint = under_mass(self.bare, mass.mass, mass.arm)
        self.velocity = 0.0
        if joint.gravity > joint.coulomb:
            band = math.asin(joint.coulomb / joint.gravity)
            self.angle = max(-band, min(band, self.angle))

    def start(self):
        """Switch on."""
        self.begin()

    def stop(self):
        """Switch off."""
        self.release()

    def command(self, value):
        """Set the command; return it as set."""
        return self.drive(value)

    def read(self):
        """Read clock and encoder."""
        return self.sense()

    def wait(self, duration):
        """Let time pass."""
        self.advance(duration)
