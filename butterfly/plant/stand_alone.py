"""Robots as MJCF files that move in plain MuJoCo, by themselves, as they do here.

Here MuJoCo has help: the command is delayed and shaped before it, its steps are chosen anew for
each interval, and friction that sticks harder than it slides is set step by step. A file has to say
all that itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from butterfly.arrays import Samples
from butterfly.files import write_file
from butterfly.model.kernel.equation import Constants, least_steps
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.model.terms import BEYOND_MUJOCO, DRIVE
from butterfly.plant.mjcf import built, mjcf, named, text_of
from butterfly.plant.robot import Robot

AIM = 1e-4
"""Error in rad of a free run for which the step is chosen."""

_STEPS = tuple(1e-3 / n for n in (1, 2, 4, 5, 8, 10, 20, 25, 40, 50))  # s: all divide 1 ms
_GRIP = 0.25  # steps: time constant with which dry friction stops the joint
_BRISTLE_STEP = 1e-4  # s, from which on MuJoCo's bristles, which are of first order, keep to AIM
_CURRENT_STEP = 2e-5  # s, the same of its current
_DELAYED = 1.5  # steps, from which on MuJoCo delays a command by any time
_NO_DELAY = 1e-5  # s, in which no joint of up to 10 rad/s moves by AIM
_FELT = 7.5e-5  # s, from which on steps are made short enough for a delay
_TURNING = 3.0  # errors by dry friction, as shares of its acceleration times step over resonance
_SLOWEST = 2.0  # rad/s, taken for the resonance of a joint that hardly has one
_KNOTS = 24  # of the polygon that stands for Stribeck's curve,
_REACH = 3.0  # Stribeck velocities long: there all but 1e-4 is lost
_CROWD = 1.3  # by which power they crowd about 0, where most logs are
_FINE = 4001  # points at which the polygon is fitted to the curve
_NO_GAIN = 1e-30  # MuJoCo takes a gain of 0 beside a slope for a damping ratio


@dataclass(frozen=True, kw_only=True)
class StandAlone:
    """A robot's file: MJCF with light and camera, and in sentences what it leaves out."""

    text: str
    step: float  # s
    left_out: tuple[str, ...]

    def write(self, path: Path) -> None:
        """Write the file."""
        write_file(path, self.text)


def stand_alone(
    robot: Robot,
    added: AddedMass = NO_ADDED_MASS,
    *,
    delay: float = 0.0,
    slow_delay: float = 0.0,
    limit: float = math.inf,
    resolution: float = 0.0,
    dead_zone: float = 0.0,
    compression: float = 0.0,
) -> StandAlone:
    """Return a robot that moves by itself in plain MuJoCo, driven by the first of its commands.

    The command's path is that of `butterfly.plant.motor.CommandPath`; a negative delay, as an
    estimate may be, is left out, and in silence one of up to 10 us.
    """
    friction = robot.loaded(added)
    step, left_out = _step_for(robot, friction, delay)
    if beyond := [name for name in BEYOND_MUJOCO if getattr(friction, name)]:
        left_out.append(
            "MuJoCo has no friction that torque or angle change: set dof_frictionloss yourself in "
            f"each step, for {', '.join(beyond)}"
        )
    if slow_delay:
        left_out.append(
            f"The delay is that of the fast clock: of the {1e3 * slow_delay:+.3g} ms in a clock's "
            "slow regime nothing is in the file"
        )
    for flaw, remedy in (
        (resolution, "does not round commands: set ctrl to multiples of {:g}"),
        (dead_zone, "has no command that is lost: take up to {:g} towards 0 from ctrl"),
        (compression, "has no gain that falls with the command: set ctrl to u/(1 + {:g} |u|)"),
    ):
        if flaw > 0:
            left_out.append(f"MuJoCo {remedy.format(flaw)} yourself")
    root = built(_sliding(robot), added, scene=True)
    next(root.iter("option")).set("timestep", repr(step))
    next(root.iter("flag")).set("refsafe", "disable")  # lets friction grip within a step
    named(root, "hinge").set("solreffriction", f"{_GRIP * step!r} 1")
    motor = named(root, "motor")
    if math.isfinite(limit):
        motor.set("ctrlrange", f"{-limit!r} {limit!r}")
    if _can_delay(delay, step):
        motor.attrib |= {
            "delay": repr(delay + step / 2),
            "nsample": str(math.ceil(delay / step) + 2),
            "interp": "linear",
        }
    if friction.stribeck and not friction.bristle_stiffness:
        next(root.iter("actuator")).extend(_slips(friction))
    late = f", a delay of {1e3 * delay:.4g} ms included" if _can_delay(delay, step) else ""
    first = (
        f"Moves by itself in plain MuJoCo, driven by ctrl[0] (motor){late}; other commands stay 0. "
        "The step was chosen for what friction and delay ask for."
    )
    for k, sentence in enumerate([first, *left_out]):
        comment = ElementTree.Comment(f" {sentence} ")
        comment.tail = "\n  "
        root.insert(k, comment)
    return StandAlone(text=text_of(root), step=step, left_out=tuple(left_out))


def command_of(parameters: LumpedParameters) -> dict[str, float]:
    """Return what becomes of the command before it is a torque, as `stand_alone` takes it."""
    return {name: float(getattr(parameters, name)) for name in ("delay", "slow_delay", *DRIVE)}


def models(
    drawn: Iterable[LumpedParameters],
    added: AddedMass = NO_ADDED_MASS,
    *,
    mass: float | None = None,
    bristle_stiffness: float = 0.0,
) -> Iterator[str]:
    """Yield the MJCF text of a robot for each set of parameters, for domain randomisation.

    The parameters are of the bare hand. The input delay is left out; friction that is larger at
    rest needs a ``bristle_stiffness`` in N m/rad (`stand_alone` has both).
    """
    for parameters in drawn:
        bends = bristle_stiffness if parameters.stribeck > 0 else 0.0
        bent = replace(parameters, bristle_stiffness=bends) if bends else parameters
        yield mjcf(Robot.of_lumped(bent, mass), added)


def _can_delay(delay: float, step: float) -> bool:
    return delay >= _DELAYED * step * (1 - 1e-9)


def _step_for(robot: Robot, friction: LumpedParameters, delay: float) -> tuple[float, list[str]]:
    """Return the longest step in s that keeps to `AIM`, and what none does.

    MuJoCo's dry friction turns round up to a step from where the joint does, which costs a velocity
    in proportion to its acceleration times the step. A delay takes a step and a half at least.
    """
    longest, strength = _STEPS[0], 0.0
    constants = Constants.of(friction)
    if constants.lag > 0:
        longest = _CURRENT_STEP
    if constants.bristle_stiffness > 0:
        longest = min(longest, _BRISTLE_STEP, 1e-3 / max(least_steps(constants, 0.0, 1e-3), 1))
    else:
        inertia = robot.clutch.rotor_inertia if robot.clutch else friction.p1
        resonance = max(math.sqrt(abs(friction.p3) / friction.p1), _SLOWEST)
        strength = _TURNING * friction.holding / inertia / resonance
        longest = min(longest, AIM / strength) if strength else longest
    if delay >= _FELT:
        longest = min(longest, delay / _DELAYED)
    step = next((each for each in _STEPS if each <= longest * (1 + 1e-9)), _STEPS[-1])
    sentences = []
    if strength * step > AIM * (1 + 1e-9):
        sentences.append(
            f"Friction this strong is up to some {strength * step:.1g} rad off at MuJoCo's step of "
            f"{1e3 * step:g} ms"
        )
    if delay < -_NO_DELAY:
        sentences.append(
            f"The delay of {1e3 * delay:.3g} ms is left out: no robot moves before it is told"
        )
    elif delay > _NO_DELAY and not _can_delay(delay, step):
        sentences.append(
            f"The delay of {1e3 * delay:.3g} ms is left out: MuJoCo has none shorter than one and "
            f"a half of its steps of {1e3 * step:g} ms"
        )
    return step, sentences


def _sliding(robot: Robot) -> Robot:
    """Return the robot with dry friction that is at all velocities what it is at rest."""
    friction = robot.friction
    if not friction.sticks_harder:
        return robot
    always: dict[str, float] = {"coulomb": friction.holding, "stribeck": 0.0}
    return replace(robot, friction=replace(friction, **always | dict.fromkeys(BEYOND_MUJOCO, 0.0)))


def _slips(friction: LumpedParameters) -> list[ElementTree.Element]:
    """Return actuators that take from that friction what it loses once the joint slides.

    T_s (1 - exp(-(v/v_s)^2)) sgn v is a polygon in v, and that a sum of ramps that end: negative
    dampers of limited torque, one for each knot.
    """
    knots = _REACH * np.linspace(0.0, 1.0, _KNOTS + 1) ** _CROWD
    slopes = np.diff(_polygon(knots)) / np.diff(knots)
    bends = slopes - np.append(slopes[1:], 0.0)
    damping = friction.stribeck / friction.stribeck_velocity * bends
    most = friction.stribeck * abs(bends) * knots[1:]
    return [
        ElementTree.Element(
            "general",
            name=f"slip_{k}",
            joint="hinge",
            gainprm=repr(_NO_GAIN),
            biastype="affine",
            biasprm=f"0 0 {slope!r}",
            forcerange=f"{-end!r} {end!r}",
        )
        for k, (slope, end) in enumerate(zip(damping.tolist(), most.tolist(), strict=True), 1)
    ]


def _polygon(knots: Samples) -> Samples:
    """Return the (n,) values at knots of the polygon nearest to 1 - exp(-x^2), from 0 to 1.

    One through points of the curve would brake too little throughout its first, convex part.
    """
    points = np.linspace(0.0, knots[-1], _FINE)
    _, *inner, last = np.eye(knots.size)
    hats = np.array([np.interp(points, knots, hat) for hat in inner])
    rest = 1.0 - np.exp(-(points**2)) - np.interp(points, knots, last)
    return np.asarray(last + np.linalg.lstsq(hats.T, rest, rcond=None)[0] @ np.array(inner))
