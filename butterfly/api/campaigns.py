"""The verb of a campaign, and what it came to."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from butterfly.api.identification import Identification
from butterfly.api.sources import Named
from butterfly.api.verbs import share_of
from butterfly.campaigns.bench import Limits
from butterfly.campaigns.campaign import Carry, Ended, Wish, conduct
from butterfly.campaigns.folder import Folder
from butterfly.errors import InputError
from butterfly.experiment.source import read_experiment
from butterfly.files import locate
from butterfly.identification.design import OF_GOAL
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from butterfly.model.prior import Prior, plain
from butterfly.outputs import call
from butterfly.plant.motor import Motor
from butterfly.plant.rig import SimulatedMotor
from butterfly.report.finding_texts import estimate_verdict
from butterfly.report.format import field_name
from butterfly.result import Answer, cell_text

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from butterfly.report.page import Fact

PAGE = "report.html"
"""File of its report, its numbers beside it."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Campaign(Answer):
    """What a campaign came to."""

    kind: ClassVar[str] = "campaign"

    page_path: Path | None = None
    """The written report; None for a result that was loaded."""

    identification: Identification | None = None
    """Of all its logs; None if they determine nothing, or for a result that was loaded."""

    @classmethod
    def of(cls, ended: Ended, wish: Wish, folder: Path) -> Campaign:
        """Tabulate the runs."""
        steps, found = ended.journal.steps, ended.identified
        begins = [0.0, *(step.seconds for step in steps)]
        rows = [
            {
                "run": number,
                "played": step.what,
                "added mass": str(step.added_mass),
                "robot time in s": step.seconds,
                "length in s": step.seconds - begin,
                "why": step.why,
                "ended early": step.cut,
                "verdict": step.verdict,
                "the model misses": step.misses,
                **{name: step.shares.get(name) for name in OF_GOAL},
            }
            for number, (step, begin) in enumerate(zip(steps, begins, strict=False))
        ]
        verdict = None if found is None else estimate_verdict(found.estimate)
        return cls(
            title=f"Campaign {folder.name!r}",
            summary=(*(verdict.lines if verdict else ()), *_sentences(ended, wish, folder)),
            judged=verdict,
            content={
                "goal": wish.goal,
                "reached": ended.reached,
                "ending": ended.ending,
                "robot_time": steps[-1].seconds if steps else 0.0,
                "changes": _changes(ended),
                **ended.journal.contact._asdict(),
                "held_out": {} if found is None else found.held_out,
                "rows": rows,
            },
            units={"robot_time": "s", "breakaway": "unit", "held_out": "%"},
            identification=None if found is None else Identification.of(found),
        )

    @property
    def reached(self) -> bool:
        """Whether all half-widths are within the goal, under a verdict *good*."""
        return bool(self.content["reached"])

    def shown_rows(self) -> list[dict[str, str]]:
        """Return the runs, half-widths over what is wanted with two digits."""
        hidden = {"length in s", "why", "ended early", *OF_GOAL}
        shown = []
        for row in self.rows():
            shares = {f"{k} / goal": f"{row[k]:.2g}" if row[k] else "–" for k in OF_GOAL}
            shown.append({k: cell_text(v) for k, v in row.items() if k not in hidden} | shares)
        return shown

    def figures(self) -> dict[str, Figure]:
        """Return how intervals shrank, and what was played."""
        from butterfly.report.campaign_page import played, shrinking  # noqa: PLC0415 - a view

        rows = self.rows()
        return {"shrinking": shrinking(rows, OF_GOAL), "played": played(rows)} if rows else {}

    def facts(self) -> list[Fact]:
        """Return the numbers that matter most."""
        from butterfly.report.page import Fact  # noqa: PLC0415 - a view

        content = self.content
        return [
            Fact("goal", f"{100 * content['goal']:.3g} %", "reached" if self.reached else "missed"),
            Fact("robot time", f"{content['robot_time']:.0f} s", f"{len(self.rows())} runs"),
            Fact("changes of mass", str(content["changes"])),
            Fact("moves at", f"{content['breakaway']:.3g}", "units of the input"),
        ]


def campaign(
    robot: Named | Motor,
    *,
    out: Named | None = None,
    goal: float | str = "1%",
    masses: Sequence[float] | None = None,
    arm: float = 0.0,
    command: float | None = None,
    angle: float = 1.0,
    speed: float | None = None,
    current: float | None = None,
    seconds: float = 600.0,
    price: float = 120.0,
    step: float | None = None,
    known: Mapping[str, Any] | None = None,
    change: Carry | None = None,
) -> Campaign:
    """Run experiments on an unknown joint that choose themselves, until a goal is reached.

    Finds which way the drive turns, plays a safe probe, and after each run identifies the joint and
    chooses the next run: the one from which the goal is reached for the least robot time. Every run
    is a log of a manifest in the folder, beside a report. Called again it goes on where it stopped.

    Parameters
    ----------
    robot
        An experiment, whose robot is simulated; or MODULE:FACTORY, a function that returns a motor.
        In Python a `Motor`.
    out
        Folder for logs, manifest and report. Default: ``campaign``.
    goal
        Half-width of the 95 % intervals of p1..p4 and Coulomb friction, over their values. Of
        friction, or a gravity moment, that is hardly there the whole interval is to be below this
        share of the largest torque.
    masses
        Masses at hand in kg, the one that is mounted first. Default: those of the experiment, or
        none.
    arm
        Distance of these masses from the pivot in m.
    command
        Largest command, in units of the input. Default: that of the experiment.
    angle
        Largest angle from rest in rad.
    speed
        Largest speed, in rad/s. Default: any.
    current
        Largest current in A, where one is read. Default: any.
    seconds
        Robot time in s, at most.
    price
        Robot time in s that a change of mass is worth.
    step
        Cycle of the controller in s. Default: that of the experiment, or 0.002.
    known
        Known values, as in a manifest: ``{"p4": 1.0}``.
    change
        Mounts a mass, and returns when it is mounted; without it a motor's mass is never changed.

    Raises
    ------
    SafetyStop
        If the joint, its drive or its encoder is not as it should be; the drive is off then.
    """
    own: dict[str, Any] = {"masses": (NO_ADDED_MASS,), "known": {}, "step": 0.002}
    if isinstance(robot, str | PathLike):
        robot, own, change, limit = _named(str(robot), own, change)
        command = limit if command is None else command
    if command is None:
        expected = "the largest command that the joint may get: --command"
        raise InputError("campaign", "command", "missing", expected)
    given: dict[str, Any] = {"known": known, "step": step}
    if masses is not None:
        if any(masses) and not arm:
            raise InputError("campaign", "arm", arm, "the masses' distance from the pivot in m")
        given["masses"] = tuple(AddedMass(mass=each, arm=arm if each else 0.0) for each in masses)
    limits = {"command": command, "angle": angle, "speed": speed, "current": current}
    wish = Wish(
        goal=share_of(goal),
        limits=Limits(seconds=seconds, **{k: v for k, v in limits.items() if v is not None}),
        price=price,
        **own | {name: value for name, value in given.items() if value is not None},
    )
    if isinstance(robot, SimulatedMotor) and change is not None:
        change(wish.masses[0])
    folder = Path(out or "campaign")
    with call(folder=folder):
        found = Campaign.of(conduct(robot, wish, Folder(folder), change), wish, folder)
        found.report(folder / PAGE)
    return replace(found, page_path=folder / PAGE)


def _named(
    name: str, own: dict[str, Any], change: Carry | None
) -> tuple[Motor, dict[str, Any], Carry | None, float | None]:
    """Return the motor that a name stands for, what goes with it, and its largest command."""
    module, colon, factory = name.rpartition(":")
    if colon and module.replace(".", "").replace("_", "").isalnum():
        sys.path.insert(0, "")
        try:
            return getattr(import_module(module), factory)(), own, change, None
        except (ImportError, AttributeError) as error:
            raise InputError("campaign", "robot", name, f"MODULE:FACTORY ({error})") from None
    experiment = read_experiment(locate(Path(name)))
    rig = replace(experiment.plant.rig, fine=True)  # whose own error is none of the robot
    masses = tuple(experiment.added_masses)
    if rig.servo is not None:
        expected = "a plant without a loop: a campaign commands the drive directly"
        raise InputError(name, "plant.loop", rig.servo.law, expected)
    seen: dict[str, Any] = {"path": rig.path, "encoder": rig.encoder, "clock": rig.clock}
    rng = np.random.default_rng(experiment.seed)
    motor = SimulatedMotor(rig.joint(masses[0]), rng=rng, **seen)
    sizes = [sine.amplitude for sine in experiment.excitations]
    limit = rig.path.limit if np.isfinite(rig.path.limit) else max(sizes, default=None)
    known = {name: plain(value) for name, value in Prior.of(experiment.known).parameters.items()}
    own = {"masses": masses, "known": known, "step": rig.clock.step}
    return motor, own, lambda mass: motor.mount(rig.joint(mass)), limit


def _changes(ended: Ended) -> int:
    return sum(a.added_mass != b.added_mass for a, b in itertools.pairwise(ended.journal.steps))


def _sentences(ended: Ended, wish: Wish, folder: Path) -> list[str]:
    """Say whether the goal is reached, with what, and what is missing."""
    steps, changes = ended.journal.steps, _changes(ended)
    seconds = steps[-1].seconds if steps else 0.0
    goal, cost = f"{100 * wish.goal:.3g} %", f"{seconds:.0f} s of robot time, {len(steps)} runs"
    cost += f", {changes} change{'s' if changes != 1 else ''} of mass"
    lines = [
        f"The goal of {goal} is reached: {cost}."
        if ended.reached
        else f"The goal of {goal} is not reached after {cost}: {ended.ending}."
    ]
    shares = next((step.shares for step in reversed(steps) if step.shares), {})
    far = {field_name(name): share for name, share in shares.items() if share > 1}
    if far:
        listed = ", ".join(f"{name} {share:.2g} times" for name, share in far.items())
        lines.append(f"Half-widths over what is wanted: {listed}.")
    misses = next((step.misses for step in reversed(steps) if step.verdict), "")
    if misses:
        lines.append(
            f"The model misses something ({misses}): `butterfly residual {folder}` shows what "
            f"torque is left; `butterfly identify {folder} --terms NAME` fits a term."
        )
    for name, fit in (ended.identified.held_out if ended.identified else {}).items():
        lines.append(f"The last run ({name}) was not fitted: predicted with a FIT of {fit:.4g} %.")
    return lines
