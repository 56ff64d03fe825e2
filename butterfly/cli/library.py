"""`butterfly library`: motors that others measured, listed and shown; a file for yours."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from butterfly.cli.options import OUT
from butterfly.cli.output import ExitCode, OutputFile, say, say_verdict, show_table, write_json
from butterfly.errors import InputError
from butterfly.files import locate, write_file

if TYPE_CHECKING:
    from butterfly.logs.motors import MeasuredMotor, MotorType, SharedValue

_HEADERS = ("name", "motor", "drive", "verdict", "measured", "values")


def list_motors() -> None:
    """List the motors of the library."""
    from butterfly.logs.motors import motor_names, motor_of  # noqa: PLC0415 - slow to import
    from butterfly.result import document  # noqa: PLC0415

    motors = {name: motor_of(name) for name in motor_names()}
    rows = [
        (name, f"{m.maker} {m.name}", m.drive, m.verdict, m.count, ", ".join(m.known))
        for name, m in motors.items()
    ]
    show_table("Motors", _HEADERS, rows)
    say("To use one: butterfly identify LOGS --known from=NAME. To add yours: docs/library.md.")
    plain = [{"name": name, **_numbers(motor)} for name, motor in motors.items()]
    write_json(document("motors", "Motors", {"count": len(plain), "rows": plain}))


def show_motor(
    name: Annotated[str, Parameter(help="Its name in the library, or a file (.yaml).")], /
) -> None:
    """Show a motor: what it takes to another joint, and where that is from."""
    from butterfly.logs.motors import motor_of, motor_path  # noqa: PLC0415 - slow to import
    from butterfly.result import document  # noqa: PLC0415

    motor = motor_of(name)
    titled = f"{motor.maker} {motor.name}"
    say(f"{motor.verdict.capitalize()}: {titled}, driven by {motor.drive}; {motor.count} measured.")
    say(f"To use it: butterfly identify LOGS --known from={name}")
    show_table(
        "What it takes to another joint",
        ("", "value ± standard error", "measured, 95 %", "between motors", "unit"),
        [_row(name, value) for name, value in motor.known.items()],
    )
    say(f"Scatter between motors: {motor.scatter}.")
    for number, measured in enumerate(motor.motors, 1):
        _show_measured(measured, f" {number}" if len(motor.motors) > 1 else "")
    say(f"File: {motor_path(name)}")
    write_json(document("motor", titled, _numbers(motor)))


def _show_measured(motor: MeasuredMotor, number: str) -> None:
    """Show under which conditions a motor was measured, and where that is from."""
    source = motor.source
    pairs = [
        ("verdict", motor.verdict),
        *motor.conditions.items(),
        ("source", f"{source.repository} {source.commit[:12]}, {source.folder}"),
        ("licence", f"{source.licence}, {source.holder}"),
        ("made by", f"{motor.made.command} (butterfly {motor.made.version})"),
    ]
    show_table(f"Motor{number}", (), pairs)
    if motor.rig:
        values = (f"{name} = {x.value:g} {x.unit.strip('–')}" for name, x in motor.rig.items())
        say(f"Of the joint it was measured in, not used: {', '.join(map(str.strip, values))}.")
    for note in motor.notes:
        say(note)


def draft_motor(
    source: Annotated[Path, Parameter(help="A saved result.")],
    /,
    *,
    out: Annotated[Path, OUT, OutputFile((".yaml", ".yml"))],
) -> ExitCode:
    """Write a file for the library from a saved result: your motor's values, the rest to fill in.

    Name, maker, conditions and source are left empty. `butterfly library show FILE` says what is
    still missing.

    Parameters
    ----------
    out
        File to write.
    """
    from butterfly.api.verbs import saved_identification  # noqa: PLC0415 - slow to import
    from butterfly.twin.motor_file import motor_draft  # noqa: PLC0415

    identified = saved_identification(locate(source))
    if identified is None:
        raise InputError(source, "path", "no saved result", "one of butterfly identify --save")
    text = motor_draft(identified)
    if identified.judged is not None:
        say_verdict(identified.judged)
    write_file(out, text)
    say(f"Motor: {out}. Fill in name, maker, conditions and source.")
    say(f"Next: butterfly library show {shlex.quote(str(out))}")
    return ExitCode.of(identified.judged)


def _row(name: str, value: SharedValue) -> tuple[str, ...]:
    """Tabulate a value."""
    measured = ", ".join(f"{motor.lower:g} to {motor.upper:g}" for motor in value.motors)
    return name, str(value.known()), measured, f"± {100 * value.scatter:.3g} %", value.unit


def _numbers(motor: MotorType) -> dict[str, object]:
    """Return a motor for programs, with the uncertainty of each value in another joint."""
    known = {
        name: {
            "value": value.value,
            "uncertainty": value.known().uncertainty,
            "scatter": value.scatter,
            "unit": value.unit,
        }
        for name, value in motor.known.items()
    }
    content = motor.model_dump(mode="json", exclude={"name"})
    return {"motor": motor.name, "verdict": motor.verdict, "known": known, **content}
