"""Run campaigns with random robots, sound ones and such as the model misses: ``make campaigns``."""

import math
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import butterfly as bf
from butterfly.campaigns.campaign import GOAL
from butterfly.campaigns.drive import SafetyStop
from butterfly.identification.design import OF_GOAL, wanted
from butterfly.model.parameters import NO_ADDED_MASS, LumpedParameters
from butterfly.plant.motor import CommandPath, Reading
from butterfly.plant.rig import Rig, SimulatedMotor, Simulator
from butterfly.plant.robot import Clutch, Robot
from butterfly.plant.sensors import Encoder
from tests.benchmarks.coverage import options, write

KINDS = ("grey-box", "mujoco", "known-gain", "bias", "cogging", "stribeck", "drag", "tilt")
KINDS += ("base", "filter", "backlash", "wide", "wide-known")


@dataclass(frozen=True)
class Score:
    """What one campaign came to."""

    kind: str
    number: int
    reached: bool
    ending: str
    robot_time: float = math.nan  # s
    changes: int = 0
    error: float = math.nan  # the largest, over the values
    held: float = math.nan  # share of the intervals that hold the truth
    farthest: float = 0.0  # rad


class Drawn(SimulatedMotor):
    """The motor of a random robot: nearly balanced or strong, damped by 1 to 8 %.

    Of the wide kinds one in six is balanced, one in six has no Coulomb friction, others up to 30 %
    of the torque of about 1 rad; half are damped by a tenth of that; encoders have 4,096 to 65,536
    counts.

    ``steps``: of its encoder; ``dry``: largest share of the torque that friction takes.
    """

    def __init__(self, kind, number, seed, *, steps=8192, dry=0.2):
        rng = np.random.default_rng([seed, number])
        lows, highs = (
            (-3, 0.5, 0.01, -1.5, 0.4, 0.0, 0.3, 0.0),
            (-2, 9, 0.08, 0.5, 1, dry, 1, 0.008),
        )
        noise = 2e-4
        p1, natural, damping, p4, share, dry, size, delay = rng.uniform(lows, highs).tolist()
        if kind.startswith("wide"):
            natural, dry, bits = (rng.uniform(0, most) for most in (9.0, 0.3, 4.0))
            balanced, smooth = rng.uniform(size=2) < 1 / 6
            natural, dry = natural * (not balanced), dry * (not smooth)
            damping *= rng.choice([0.1, 1.0])
            steps = round(2 ** (12 + bits))
            noise = math.tau / steps / 4
        p1, p4 = 10**p1, 10**p4
        torque = max(p1 * natural**2, 4 * p1) * share  # of about 1 rad
        p2, coulomb = 2 * damping * p1 * max(natural, 1.0), dry * torque
        self.limit, self.sign = 2 * torque / p4, rng.choice([-1, 1])
        more = {
            "bias": {"bias": 0.1 * torque * size},
            "cogging": {"cogging": 0.05 * torque * size, "cogging_periods": round(20 * size)},
            "stribeck": {"stribeck": 0.6 * coulomb * size, "stribeck_velocity": 0.15},
            "drag": {"drag": 0.25 * p2 * size},
            "tilt": {"tilt": math.radians(2)},
            "base": {"base_compliance": 5e-4 * size, "base_frequency": 5 * max(natural, 2)},
        }.get(kind, {})
        p3 = p1 * natural**2
        self.true = LumpedParameters(p1=p1, p2=p2, p3=p3, p4=p4, coulomb=coulomb, **more)
        play = Clutch(backlash=0.02 * size, rotor_inertia=0.2 * p1)
        robot = replace(Robot.of_lumped(self.true), clutch=play if kind == "backlash" else None)
        self._lag = 0.01 * size if kind == "filter" else 0.0
        simulator = Simulator.MUJOCO if kind in {"mujoco", "backlash"} else Simulator.GREY_BOX
        seen = {"encoder": Encoder(steps=steps, noise=noise)}
        seen["path"] = CommandPath(limit=self.limit, delay=delay)
        self._rig = Rig(robot=robot, simulator=simulator, fine=True, **seen)
        self._last, self.farthest = None, 0.0
        super().__init__(self._rig.joint(NO_ADDED_MASS), rng=rng, **seen)

    def command(self, value):
        return self.sign * super().command(self.sign * value)

    def read(self):
        time, angle, current = super().read()
        self.farthest = max(self.farthest, abs(angle))
        if self._lag and self._last:
            last, lagging = self._last
            angle = lagging + (1 - math.exp((last - time) / self._lag)) * (angle - lagging)
        self._last = time, angle
        return Reading(time, angle, current)

    def carry(self, mass):
        self.mount(self._rig.joint(mass))
        self._last = None


def main(arguments=None):
    """Run, and print a table."""
    parser = options(__doc__, (), 20)
    parser.add_argument("--kind", nargs="*", choices=KINDS, default=KINDS)
    asked = parser.parse_args(arguments)
    jobs = [(kind, number, asked.seed) for kind in asked.kind for number in range(asked.robots)]
    write("campaigns", asked, _score, jobs, report)


def _score(job):
    motor = Drawn(*job)
    given = {"masses": (0.0, 0.05, 0.1, 0.2), "arm": 0.1, "command": motor.limit}
    if job[0] == "known-gain":
        given |= {"masses": (0.0,), "known": {"p4": motor.true.p4}}
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = bf.campaign(motor, out=Path(folder, "a"), change=motor.carry, **given)
        except SafetyStop as stop:
            return [Score(*job[:2], reached=False, ending=str(stop))]
    about = {key: found.content[key] for key in ("reached", "ending", "changes", "robot_time")}
    if found.identification is not None:
        limits = found.identification.estimate
        true = np.array([getattr(motor.true, name) for name in limits.names])
        # over what a goal is of: the value, or the largest torque where there is hardly any
        sizes = wanted(replace(limits, values=true), found.identification.data.logs, GOAL) / GOAL
        about["error"] = float(np.max(np.abs(limits.values - true) / sizes))
        every = zip(limits.names, limits.lower, limits.upper, strict=True)
        rows = [(getattr(motor.true, row[0]), *row[1:]) for row in every if row[0] in OF_GOAL]
        about["held"] = float(np.mean([low <= truth <= high for truth, low, high in rows]))
    return [Score(*job[:2], farthest=motor.farthest, **about)]


def report(scores):
    """Return a table by kind."""
    lines = [
        "| kind | reached | median s | changes | wrong claims | held | farthest rad |",
        "|---" * 7 + "|",
    ]
    for kind in dict.fromkeys(each.kind for each in scores):
        every = [each for each in scores if each.kind == kind]
        some = [each for each in every if each.reached] or every
        lines.append(
            f"| {kind} | {sum(each.reached for each in every)} of {len(every)} "
            f"| {np.median([each.robot_time for each in some]):.0f} "
            f"| {np.mean([each.changes for each in some]):.2f} "
            f"| {sum(each.reached and each.error > 0.015 for each in every)} "
            f"| {100 * np.mean([each.held for each in some]):.0f} % "
            f"| {max(each.farthest for each in every):.2f} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
