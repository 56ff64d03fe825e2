"""Simulated robots of known parameters, sound ones and such as fail."""

import math

import butterfly as bf
from butterfly.model.parameters import NO_ADDED_MASS, LumpedParameters
from butterfly.plant.motor import CommandPath, Reading
from butterfly.plant.rig import Rig, SimulatedMotor, Simulator
from butterfly.plant.robot import Robot
from butterfly.plant.sensors import Encoder

TRUE = LumpedParameters(p1=0.004, p2=0.002, p3=0.05, p4=0.3, coulomb=0.001)
COMMAND = 0.15


def rig(simulator=Simulator.GREY_BOX, true=TRUE):
    """Return a robot with its encoder and its drive, of true parameters."""
    return Rig(
        robot=Robot.of_lumped(true),
        simulator=simulator,
        encoder=Encoder(steps=8192, noise=2e-4),
        path=CommandPath(limit=COMMAND, delay=0.004),
    )


def robot(of=None):
    """Return the motor of a rig."""
    of = of or rig()
    return SimulatedMotor(of.joint(NO_ADDED_MASS), path=of.path, encoder=of.encoder)


class Faulty:
    """A robot's motor with something wrong from some time on, as ``wrong`` says."""

    def __init__(self, wrong, since=0.0, of=None):
        self._rig, self._wrong, self._since = of or rig(), wrong, since
        self._inner = robot(self._rig)
        self.input_kind = self._inner.input_kind
        self.commands, self.stopped, self._passed, self._mounts, self.farthest = [], 0, 0.0, 0, 0.0
        self._stuck, self.last_readings = 0.0, (0.0, 0.0)

    def start(self):
        self._inner.start()

    def stop(self):
        self._inner.stop()
        self.stopped += 1

    def command(self, value):
        if self._wrong == "unplugged" and self._passed >= self._since:
            raise OSError("device not configured")
        self.commands.append(value)
        acts = self._wrong == "no supply" and self._passed >= self._since
        odd = self._passed % 2 > 1
        sent = {
            "reversed": -value,
            "one way": abs(value),
            "loose": value * odd,
            "fading": value * (0.1 if odd else 1.0),
        }.get(self._wrong, value)
        self._inner.command(0.0 if acts else sent)
        return max(-COMMAND, min(COMMAND, value))

    def read(self):
        time, angle, current = self._inner.read()
        self.farthest = max(self.farthest, abs(angle))
        self.last_readings = (*self.last_readings[1:], angle)
        self._stuck = angle if self._passed < self._since else self._stuck
        at_rest = not any(self.commands[-50:])
        if self._passed < self._since or (
            self._since > 0 and self._wrong == "slips" and not at_rest
        ):
            return Reading(time, angle, current)
        beyond = self._passed - self._since
        self._since = -math.inf if self._wrong == "slips" else self._since
        return {
            "cable": Reading(time, math.nan, current),
            "frozen": Reading(time, self._stuck, current),
            "late": Reading(time + beyond * 200, angle, current),
            "back": Reading(time - 2 * beyond, angle, current),
            "slips": Reading(time, angle + 0.3, current),
            "current": Reading(time, angle, 50.0),
            "end stop": Reading(time, min(angle, 0.05), current),
        }.get(self._wrong, Reading(time, angle, current))

    def wait(self, duration):
        self._passed += duration
        self._inner.wait(duration)

    def carry(self, mass):
        self._mounts += 1
        if self._wrong != "not mounted" and (self._wrong != "mounted once" or self._mounts == 1):
            self._inner.mount(self._rig.joint(mass))


def run(motor, folder, **options):
    """Run a campaign of two masses in a folder."""
    given = {"command": COMMAND, "masses": (0.0, 0.1), "arm": 0.1, "change": motor.carry}
    given |= {"step": 0.005} | options  # a cycle that leaves time to the tests
    return bf.campaign(motor, out=folder, **given)
