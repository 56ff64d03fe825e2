"""`design` and `campaign`: which run to do next, and runs, each chosen from those before."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from butterfly.api.identification import Identification
from butterfly.api.joint_models import joint_clamped_in
from butterfly.api.sources import Data, Named
from butterfly.api.verbs import estimated
from butterfly.arguments import checked
from butterfly.campaigns.campaign import (
    CampaignCallbacks,
    CampaignOptions,
    CampaignResult,
    MountMass,
    conduct,
)
from butterfly.campaigns.folder import PAGE, Folder
from butterfly.campaigns.guard import HARD, Limits
from butterfly.errors import InputError
from butterfly.experiment.source import read_experiment
from butterfly.files import finite, locate
from butterfly.identification.data import DataSet
from butterfly.identification.design import Candidate, Plan, next_experiments, wanted
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.logs.log import InputKind
from butterfly.logs.model_facts import ModelFacts
from butterfly.logs.motors import with_motor
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from butterfly.model.prior import Prior, plain
from butterfly.plant.motor import Motor
from butterfly.plant.rig import SimulatedMotor
from butterfly.progress import Track, untracked
from butterfly.report.campaign_page import (
    breakaway_fact,
    campaign_estimate,
    campaign_notes,
    changes_of_mass,
    headline,
    parameter_numbers,
    parameters_table,
    run_rows,
    runs_table,
)
from butterfly.report.finding_texts import estimate_verdict, require_possible
from butterfly.report.format import cell_text, counted
from butterfly.report.numbers import rests_on
from butterfly.report.page import Fact, PageTable, views
from butterfly.report.summary import next_run_text
from butterfly.result import Answer


@checked
def design(
    data: Data,
    *,
    goal: float | str = "1%",
    duration: float = 40.0,
    command: float | None = None,
    swing: float | None = None,
    price: float = 120.0,
    track: Track = untracked,
) -> Answer:
    """Say which run to do next: the one that reaches a goal in the least robot time.

    Candidates: sines, multisines and free decays, with each added mass and without. Each one is
    simulated with the identified parameters.

    Parameters
    ----------
    data
        As in `residual`; logs are identified by the default method.
    goal, price
        As in `campaign`. The last log's mass is taken as mounted.
    duration
        Length of a run in s; of a servo at most that of its logs.
    command
        Largest command, in units of the input. Default: the largest one logged.
    swing
        Largest allowed swing in rad (m on a slide). Default: 1; on a slide or servo, the logs'
        largest.
    track
        Progress callback.
    """
    share = share_of(goal)
    logs, estimator, estimate = estimated(data, None, {}, ())
    require_possible(estimate)
    aim = wanted(estimate.at_limit, logs.logs, share)
    limits: dict[str, Any] = {"duration": duration, "command": command, "swing": swing}
    ranked = next_experiments(logs, estimate, aim, **limits, price=price, track=track)
    now = float(np.max(estimate.farther / aim))
    return design_answer(logs, estimator, estimate, ranked, goal=share, now=share * now)


def design_answer(
    data: DataSet,
    estimator: Estimator | None,
    estimate: Estimate,
    ranked: Sequence[Plan[Candidate]],
    *,
    goal: float,
    now: float,
) -> Answer:
    """Tabulate next runs, the cheapest way first; ``goal``: share, ``now``: largest half-width."""
    verdict = estimate_verdict(estimate)
    rows = finite(
        [
            {
                "added mass": str(plan.recipe.log.added_mass),
                "input": plan.recipe.what,
                f"swing in {data.joint.way}": plan.recipe.swing,
                "runs": plan.runs,
                "robot time in s": round(plan.seconds),
                "reached in %": 100 * goal * plan.expected[1],
                **dict(zip(estimate.names, map(float, plan.errors), strict=True)),
                "warning": plan.recipe.warning,
            }
            for plan in ranked
        ]
    )
    best, title = rows[0], f"Next runs for {data.name!r}"
    errors = f"{title}: standard errors after one run, relative to the present ones"
    named = [
        {"run": f"{row['input']}, {row['added mass']}"}
        | {name: row[name] for name in row if name not in {"input", "added mass"}}
        for row in rows
    ]
    costs = [name for name in named[0] if name not in estimate.names]
    tables = [
        _numbered(title, named, costs),
        _numbered(errors, named, estimate.names)._replace(detail=True),
    ]
    reached, current, aim = map(cell_text, (best["reached in %"], 100 * now, 100 * goal))
    facts = [
        Fact("next run", best["input"], best["added mass"]),
        Fact("robot time", f"{best['robot time in s']} s", counted(best["runs"], "run")),
        Fact("largest half-width after", f"{reached} %", f"now {current} %, goal {aim} %"),
        Fact("candidates", str(len(rows))),
    ]
    return Answer(
        kind="design",
        title=title,
        summary=verdict.after(next_run_text(ranked[0], estimate, goal, now)),
        judged=verdict,
        content={
            **rests_on(data, estimate, estimator),
            "goal": goal,
            "half_width": now,
            "rows": rows,
            **views(tables, facts, "ranking"),
        },
        units={f"rows.{name}": "1" for name in estimate.names},
    )


def _numbered(title: str, rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> PageTable:
    """Tabulate some columns of runs, which are numbered from 1."""
    cells = [
        (str(k), *(f"{v:.2f}" if isinstance(v, float) else cell_text(v) for v in values))
        for k, row in enumerate(rows, start=1)
        for values in [[row[name] for name in columns]]
    ]
    return PageTable(title, ("", *columns), cells)


def share_of(goal: float | str) -> float:
    """Return a goal as a share, given as one or in per cent."""
    try:
        share = (
            float(goal[:-1]) / 100 if isinstance(goal, str) and goal[-1:] == "%" else float(goal)
        )
    except ValueError:
        share = float("nan")
    if not 0 < share < 1:
        expected = "a share between 0 and 1, such as 0.01 or 1%"
        raise InputError("butterfly", "goal", goal, expected)
    return share


_UNITS = {"robot_time": "s"} | dict.fromkeys(
    ("held_out", "parameters.half_width", "parameters.wanted"), "%"
)


def campaign_answer(
    ended: CampaignResult, wish: CampaignOptions, folder: Path, remarks: Sequence[str] = ()
) -> Answer:
    """Tabulate parameters and runs; ``remarks`` on an earlier campaign are last."""
    journal, identified = ended.journal, ended.identified
    estimate = campaign_estimate(ended)
    verdict = None if estimate is None else estimate_verdict(estimate)
    goal, remedy = headline(ended, wish, folder)
    steps, notes = journal.steps, (*campaign_notes(ended, remedy), *remarks)
    title, rows, ratios = f"Campaign {folder.name!r}", run_rows(journal, wish), False
    numbers, unit = parameter_numbers(ended), InputKind(journal.input_kind).unit
    seconds, changes = steps[-1].seconds if steps else 0.0, changes_of_mass(journal)
    tables = []
    if estimate is not None:
        ratios = bool(estimate.ratios)
        tables.append(parameters_table("Parameters", estimate, numbers))
    if rows:
        tables.append(runs_table("Runs", rows))
    gain = None if ratios else numbers.get("p4")
    facts = [
        Fact("goal", f"{100 * wish.goal:.3g} %", "reached" if ended.reached else "missed"),
        Fact("robot time", f"{seconds:.0f} s", counted(len(rows), "run")),
        Fact("changes of mass", str(changes)),
        breakaway_fact(journal.contact.breakaway, unit, gain),
    ]
    identifications = {}
    if identified is not None:
        identifications[identified.estimator] = Identification.of(identified)
    return Answer(
        kind="campaign",
        title=title,
        summary=(goal, remedy, *(verdict.lines if verdict else ()), *notes),
        judged=verdict,
        content={
            "goal": wish.goal,
            "reached": ended.reached,
            "ending": ended.ending,
            "robot_time": seconds,
            "changes": changes,
            **journal.contact._asdict(),
            "ratios": ratios,
            "parameters": numbers,
            "held_out": {} if identified is None else identified.held_out,
            "rows": rows,
            **views(tables, facts, "shrinking", "played"),
        },
        units=_UNITS | {"breakaway": unit},
        identifications=identifications,
    )


@checked
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
    model: Named | None = None,
    of: str | None = None,
    pose: Mapping[str, float] | None = None,
    clamped: bool = False,
    change: MountMass | None = None,
    callbacks: CampaignCallbacks | None = None,
) -> Answer:
    """Run experiments on an unknown joint, each chosen from those before, until a goal is reached.

    Finds which way the drive turns, plays a safe probe, and after each run identifies the joint and
    chooses the next run: the one that reaches the goal in the least robot time. The folder then has
    a log of each run, their manifest and a report. Called again, it continues where it stopped.

    Parameters
    ----------
    robot
        An experiment, whose robot is simulated; or MODULE:FACTORY, a function that returns a motor.
        In Python a `Motor`.
    out
        Folder for logs, manifest and report: new, empty, or that of the campaign to continue.
        Default: ``campaign``.
    goal
        Half-width of the 95 % intervals of p1..p4 and Coulomb friction, over their values. For
        friction, or a gravity moment, close to 0 the whole interval has to be below this share of
        the largest torque.
    masses
        Masses at hand in kg, the mounted one first. Default: those of the experiment, or none.
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
        Largest robot time in s.
    price
        What a change of mass costs, in s of robot time.
    step
        Cycle of the controller in s. Default: that of the experiment, or 0.002.
    known
        Known values, as in a manifest: ``{"p4": 1.0}``, or ``{"from": "xl330"}``.
    model
        MJCF or URDF of the robot. It gives the joint's gravity, and bounds command and angle by its
        effort and range. The motor's angles are those of the file.
    of
        Name of the joint in that model.
    pose
        Positions of its other joints in rad or m. Default: those of its keyframe.
    clamped
        Whether the other joints of that model are clamped: a campaign records none of them.
    change
        Mounts a mass, and returns when it is mounted; without it a motor's mass is never changed.
        The drive is off meanwhile. A continued campaign calls it before its first run.
    callbacks
        Is called with what begins and why, and at each cycle (`butterfly.campaigns.campaign`).

    Raises
    ------
    InputError
        If the folder holds other files, another campaign runs in it, or its files were changed; or
        if the motor takes set-points, or is none.
    SafetyStop
        If the joint, its drive or its encoder is not as it should be; the drive is off then.
    """
    _require_numbers(arm=arm, angle=angle, speed=speed, current=current, seconds=seconds)
    if not isinstance(callbacks, CampaignCallbacks | None):
        raise InputError("campaign", "callbacks", callbacks, "a CampaignCallbacks")
    defaults: dict[str, Any] = {"masses": (NO_ADDED_MASS,), "known": {}, "step": 0.002}
    if isinstance(robot, str | PathLike):
        robot, defaults, change, limit = _named(str(robot), defaults, change)
        command = limit if command is None else command
    known = None if known is None else with_motor(known)
    asked: dict[str, Any] = {"model": model, "of": of, "pose": pose, "clamped": clamped}
    joint = _joint(asked, {**defaults["known"], **(known or {})})
    if joint is not None:
        defaults |= {"of_model": joint.fields, "known": {**joint.known, **defaults["known"]}}
        known = None if known is None else {**joint.known, **known}
        angle, command = min(angle, joint.angle), joint.least(command)
    if command is None:
        expected = "the largest command that the joint may get: --command"
        raise InputError("campaign", "command", "missing", expected)
    given: dict[str, Any] = {"known": known, "step": step}
    if masses is not None:
        given["masses"] = _at_arm(masses, arm)
    limits = {"command": command, "angle": angle, "speed": speed, "current": current}
    wish = CampaignOptions(
        goal=share_of(goal),
        limits=Limits(seconds=seconds, **{k: v for k, v in limits.items() if v is not None}),
        price=price,
        **defaults | {name: value for name, value in given.items() if value is not None},
    )
    if joint is not None:
        wish = replace(wish, masses=tuple(map(joint.carrying, wish.masses)))
    if change is None:
        wish = replace(wish, masses=wish.masses[:1])
    elif isinstance(robot, SimulatedMotor):
        change(wish.masses[0])
    folder = Path(out or "campaign")
    with Folder(folder) as store:
        store.notes += [] if joint is None else [joint.note]
        for note in store.notes:
            (callbacks or CampaignCallbacks()).phase(note)
        ended = conduct(robot, wish, store, change, callbacks)
        answer = campaign_answer(ended, wish, folder, store.notes)
        answer.report(store.path / PAGE)
    return replace(answer, reports=(folder / PAGE,))


@dataclass(frozen=True, kw_only=True)
class _JointOfFile:
    """What a robot's model gives a campaign with one of its joints."""

    fields: dict[str, Any]  # of the manifest
    known: dict[str, Any]
    angle: float  # rad from rest, at most
    command: float | None  # at most; None if the model does not limit it, or p4 is not known

    def carrying(self, mass: AddedMass) -> AddedMass:
        """Return an added mass under the joint's own gravity."""
        return replace(mass, gravity=self.fields["gravity"])

    def least(self, command: float | None) -> float | None:
        """Return the smaller one of two limits that may be missing."""
        return min((some for some in (command, self.command) if some is not None), default=None)

    @property
    def note(self) -> str:
        """Say what the model limits."""
        pulled = "" if self.command is None else f", commands up to {self.command:.3g}"
        name = f"{self.fields['of']} of {Path(self.fields['model']).name}"
        return f"By {name}: at most {self.angle:.3g} rad from rest{pulled}; the others are clamped."


def _joint(asked: Mapping[str, Any], known: Mapping[str, Any]) -> _JointOfFile | None:
    """Return the joint of a model that is asked for, if one is."""
    if asked["model"] is None or asked["of"] is None:
        for name, other in (("model", "of"), ("of", "model"), ("pose", "model")):
            if asked[name]:
                raise InputError("campaign", name, asked[name], f"{other} as well")
        return None
    if not asked["clamped"]:
        expected = "true, of other joints that are clamped: a campaign records none of them"
        raise InputError("campaign", "clamped", "nothing", expected)
    path = locate(Path(asked["model"]))
    fields = joint_clamped_in(path, asked["of"], asked["pose"] or {})
    facts = ModelFacts.model_validate(fields["facts"])
    efforts = [facts.effort, *(actuator.effort for actuator in facts.actuators)]
    effort = min((some for some in efforts if some), default=None)
    gain = Prior.of({n: v for n, v in known.items() if n == "p4"}).parameters.get("p4")
    return _JointOfFile(
        known=fields.pop("known"),
        fields=fields,
        angle=_room(facts, path) / HARD,
        command=effort / abs(gain.value) if effort and gain and gain.value else None,
    )


def _room(facts: ModelFacts, path: Path) -> float:
    """Return how far in rad a joint is from the ends of its range where it hangs.

    One that gravity does not move begins in the middle.
    """
    if facts.range is None:
        return math.inf
    (low, high), (pose,) = facts.range, facts.poses
    middle = (low + high) / 2
    rest = middle
    if pose.moment:
        rest = pose.zero + math.tau * round((middle - pose.zero) / math.tau)
    room = min(rest - low, high - rest)
    if room <= 0:
        where = f"{facts.joint} hangs at {rest:.3g} rad, outside of {low:.3g} to {high:.3g}"
        expected = "a joint that hangs within its range: between runs a campaign lets it hang"
        raise InputError(path, "range", where, expected)
    return room


def _at_arm(masses: Sequence[float], arm: float) -> tuple[AddedMass, ...]:
    """Return masses in kg at a distance in m from the pivot."""
    if any(masses) and not arm:
        raise InputError("campaign", "arm", arm, "the masses' distance from the pivot in m")
    return tuple(AddedMass(mass=mass, arm=arm if mass else 0.0) for mass in masses)


def _require_numbers(**given: float | None) -> None:
    """Raise InputError for a limit that is no number."""
    for name, value in given.items():
        if not isinstance(value, Real | None):
            raise InputError("campaign", name, value, "a number")


def names_motor(name: str) -> bool:
    """Whether a name is MODULE:FACTORY, of a motor that is not simulated by this program."""
    module, colon, factory = name.rpartition(":")
    return bool(colon) and factory.isidentifier() and module.replace(".", "_").isidentifier()


def _made(name: str) -> Motor:
    """Return the motor that a factory makes; InputError if it makes none."""
    module, _, factory = name.rpartition(":")
    sys.path.insert(0, "")
    try:
        motor: Motor = getattr(import_module(module), factory)()
    except Exception as error:
        failure = f"{name} ({type(error).__name__}: {error})"
        expected = "MODULE:FACTORY, a function without arguments that returns a Motor"
        raise InputError("campaign", "robot", failure, expected) from error
    finally:
        sys.path.remove("")
    return motor


def _named(
    name: str, defaults: dict[str, Any], change: MountMass | None
) -> tuple[Motor, dict[str, Any], MountMass | None, float | None]:
    """Return a named motor, its default settings, its change of masses, and its largest command."""
    if names_motor(name):
        return _made(name), defaults, change, None
    experiment = read_experiment(locate(Path(name)))
    # fine: the error of the integration is no property of the robot
    rig = replace(experiment.plant.rig, fine=True)
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
    defaults = {"masses": masses, "known": known, "step": rig.clock.step}
    return motor, defaults, lambda mass: motor.mount(rig.joint(mass)), limit
