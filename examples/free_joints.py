"""Logs of joints that nothing holds, as somebody else's controller writes them.

A cart on a relay, an arm's joint that goes from place to place, a positioner along a sweep, and a
servo whose firmware nobody knows but whose current is logged. All are simulated; each becomes a
folder of CSV files:

    python -m examples.free_joints --out .
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from butterfly.model.parameters import LumpedParameters
from butterfly.plant.joints import GreyBoxJoint
from butterfly.plant.motor import CommandPath, ControlLoop
from butterfly.plant.rig import SimulatedMotor
from butterfly.plant.robot import Robot
from butterfly.plant.sensors import Clock, Encoder, FilteredDifference

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from butterfly.plant.motor import ControlLaw, Reading


class Example(NamedTuple):
    """A joint, the law of a log's number and limit that drives it, and how it is logged."""

    joint: LumpedParameters
    law: Callable[[int, float], ControlLaw]
    limit: float  # of the command
    encoder: Encoder
    columns: str
    logs: int
    seconds: float
    period: float = 0.005  # of the loop, s


def relay(number: int, limit: float) -> ControlLaw:
    """Return full force one way, and the other way beyond some decimetres."""
    reach, way = 0.1 + 0.05 * number, 1.0

    def law(reading: Reading) -> float:
        nonlocal way
        if way * reading.angle > reach:
            way = -way
        return way * limit

    return law


def tracking(
    wanted: Callable[[int, float], float], stiffness: float, damping: float
) -> Callable[[int, float], ControlLaw]:
    """Return a PD law for each number of a log, along wanted angles of number and time in s."""

    def of_number(number: int, _: float) -> ControlLaw:
        slope = FilteredDifference(0.01)

        def law(reading: Reading) -> float:
            velocity = slope.update(reading.time, reading.angle, 0.0)
            return stiffness * (wanted(number, reading.time) - reading.angle) - damping * velocity

        return law

    return of_number


def places(number: int, time: float) -> float:
    """Return the place in rad where an arm is wanted, another one every 1.5 s."""
    return float(np.random.default_rng([number, int(time / 1.5)]).uniform(-1.0, 1.0))


def sweep(number: int, time: float) -> float:
    """Return an angle in rad along a sine that becomes faster."""
    return (0.3 + 0.1 * number) * math.sin(2.0 * math.pi * (0.1 * time + 0.02 * time**2))


EXAMPLES = {
    "cart": Example(
        LumpedParameters(p1=5.0, p2=4.0, p3=0.0, p4=1.0, coulomb=6.0),
        *(relay, 25.0, Encoder(steps=40_000, noise=1e-4), "t,force,x", 3, 20.0),
    ),
    "arm": Example(
        LumpedParameters(p1=0.35, p2=0.25, p3=0.0, p4=1.0, coulomb=0.8),
        *(tracking(places, 12.0, 3.0), 8.0, Encoder(steps=16_384), "t,torque,q", 2, 60.0),
    ),
    "positioner": Example(
        LumpedParameters(p1=0.008, p2=0.004, p3=0.0, p4=1.0, coulomb=0.05),
        *(tracking(sweep, 1.2, 0.12), 0.4, Encoder(steps=8192), "t,torque,angle", 2, 40.0),
    ),
    "servo": Example(
        LumpedParameters(p1=0.02, p2=0.05, p3=0.0, p4=1.6, coulomb=0.2),
        *(tracking(places, 2.0, 0.1), 1.5, Encoder(steps=4096), "t,current,angle", 2, 40.0, 0.01),
    ),
}
"""By folder; the delay is 4 ms, and the cart's angles are in m."""


def written(name: str, folder: Path) -> None:
    """Simulate an example, and write its logs."""
    made = EXAMPLES[name]
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(made.logs):
        rng = np.random.default_rng(number)
        motor = SimulatedMotor(
            GreyBoxJoint(Robot.of_lumped(made.joint)),
            path=CommandPath(limit=made.limit, delay=0.004),
            encoder=made.encoder,
            rng=rng,
        )
        with ControlLoop(motor, clock=Clock(step=made.period), rng=rng) as loop:
            log = loop.run(made.law(number, made.limit), made.seconds)
        rows = np.column_stack([log.time, log.input, log.angle])
        path = folder / f"run{number + 1}.csv"
        np.savetxt(path, rows, "%.7g", ",", header=made.columns, comments="")


def main(arguments: Sequence[str] | None = None) -> None:
    """Write all examples."""
    parser = argparse.ArgumentParser(description="Simulate logs of joints that nothing holds.")
    parser.add_argument("--out", type=Path, default=Path(), help="where the folders go")
    out = parser.parse_args(arguments).out
    for name, made in EXAMPLES.items():
        written(name, out / name)
        print(f"{out / name}: {made.logs} logs of {made.seconds:g} s")


if __name__ == "__main__":
    main()
