"""Drive a joint with sines, and keep logs that ``butterfly identify`` reads.

The drive holds torques in N m, so that the gain p4 is known, and one mass is enough:

    pip install -e '.[can]'
    python -m examples.record_sines --rehearse --out logs      # without a drive
    python -m examples.record_sines --channel can0 --amplitude 0.1 --limit 0.3 --out logs
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import can
import numpy as np

from butterfly.errors import InputError
from butterfly.logs.csv import write_csv
from butterfly.logs.log import InputKind, Sine
from butterfly.logs.manifest import MANIFEST_NAME, LogEntry, Manifest, write_manifest
from butterfly.model.prior import Known
from butterfly.plant.motor import ControlLoop
from butterfly.plant.sensors import Clock
from examples.odrive_can import DriveError, ODrive
from examples.odrive_stand_in import rehearsal

if TYPE_CHECKING:
    from collections.abc import Sequence

    from butterfly.logs.log import Log
    from butterfly.plant.motor import Motor, Reading

STILL = 2e-3
"""A joint that keeps within so many rad for a second is at rest."""

PATIENCE = 120
"""Seconds to wait for rest."""


def record(
    motor: Motor,
    sines: Sequence[Sine],
    folder: Path,
    *,
    seconds: float,
    period: float,
    gain: Known,
) -> Path:
    """Drive one sine after the other, each from rest; write a log of each and their manifest.

    Parameters
    ----------
    motor
        Real or simulated, driven with torques.
    sines
        In rad/s and N m.
    folder
        Where the files go.
    seconds
        Length of each log.
    period
        Of the control loop in s.
    gain
        N m at the joint per N m commanded, and how well that is known.

    Returns
    -------
    Path of the manifest.
    """
    folder.mkdir(parents=True, exist_ok=True)
    entries = []
    with ControlLoop(motor, clock=Clock(step=period)) as loop:
        for sine in sines:
            come_to_rest(loop)
            log = driven(loop, sine, seconds, begin=motor.read().time)
            motor.command(0.0)  # it would hold the last while the file is written
            entry = LogEntry(
                file=f"{sine.omega:g}_rad_s.csv", omega=sine.omega, amplitude=sine.amplitude
            )
            write_csv(log, folder / entry.file)
            entries.append(entry)
            print(f"{entry.file}: the joint swings over {np.ptp(log.angle):.2f} rad")
    manifest = Manifest(
        name=folder.resolve().name, input=InputKind.TORQUE, known={"p4": gain}, logs=entries
    )
    write_manifest(manifest, folder / MANIFEST_NAME)
    return folder / MANIFEST_NAME


def come_to_rest(loop: ControlLoop) -> None:
    """Command nothing until the joint is at rest.

    Raises
    ------
    DriveError
        If it is not within `PATIENCE`.
    """
    for _ in range(PATIENCE):
        if np.ptp(loop.run(lambda _: 0.0, 1.0).angle) < STILL:
            return
    raise DriveError(f"the joint still moves after {PATIENCE} s without torque")


def driven(loop: ControlLoop, sine: Sine, seconds: float, *, begin: float) -> Log:
    """Return the log of a sine that begins at an instant of the motor's clock."""

    def law(reading: Reading) -> float:
        return sine.amplitude * math.sin(sine.omega * (reading.time - begin))

    return loop.run(law, seconds, excitation=sine)


def main(arguments: Sequence[str] | None = None) -> None:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(description="Drive a joint with sines, and keep logs.")
    add = parser.add_argument
    add("--interface", default="socketcan", help="python-can's name for the kind of CAN adapter")
    add("--channel", default="can0", help="its name for the adapter")
    add("--rehearse", action="store_true", help="with a simulated drive, in simulated time")
    add("--node", type=int, default=0, help="the axis's can.node_id")
    add("--period", type=float, default=0.01, help="its can.encoder_msg_rate_ms, in s")
    add("--gear", type=float, default=1.0, help="turns of the motor per turn of the joint")
    add("--limit", type=float, default=0.3, help="largest torque at the joint, N m")
    add("--amplitude", type=float, default=0.1, help="of the sines, N m")
    add("--omegas", type=float, nargs="+", default=[3, 4.5, 5.5, 6.5, 8], help="rad/s")
    add("--seconds", type=float, default=40.0, help="length of each log")
    add("--uncertainty", type=float, default=0.0, help="of the torque, as a share of it")
    add("--out", type=Path, default=Path("logs"), help="folder of the logs")
    options = parser.parse_args(arguments)
    try:
        manifest = record_as(options)
    except (DriveError, InputError) as error:
        sys.exit(f"Stopped: {error}")
    except can.CanError as error:
        sys.exit(
            f"No message gets through: {error}. If the axis is armed, its watchdog alone stops it"
        )
    print(f"{manifest} names them: butterfly identify {options.out}")


def record_as(options: argparse.Namespace) -> Path:
    """Record what the command line names; return the manifest's path."""
    sines = [Sine(omega=omega, amplitude=options.amplitude) for omega in options.omegas]
    gain = Known(value=1.0, uncertainty=options.uncertainty)
    with bus_of(options) as bus:
        motor = ODrive(
            bus, limit=options.limit, node=options.node, period=options.period, gear=options.gear
        )
        timing = {"seconds": options.seconds, "period": options.period}
        return record(motor, sines, options.out, **timing, gain=gain)


def bus_of(options: argparse.Namespace) -> can.BusABC:
    """Open the bus that the command line names."""
    if options.rehearse:
        return rehearsal(node=options.node, period=options.period)
    try:
        return can.Bus(interface=options.interface, channel=options.channel)
    except (OSError, can.CanError) as error:
        raise DriveError(f"no bus {options.channel} of {options.interface}: {error}") from None


if __name__ == "__main__":
    main()
