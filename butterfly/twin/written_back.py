"""Identified values written into the robot's own MJCF or URDF, and how that joint moves."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import mujoco
import numpy as np

from butterfly.arrays import Samples, joined
from butterfly.errors import InputError
from butterfly.identification.free_run import Setting, fit_of
from butterfly.identification.identified import Identified
from butterfly.logs.log import Log
from butterfly.logs.manifest import LogEntry
from butterfly.logs.model_facts import ActuatorFacts, ModelFacts
from butterfly.model.parameters import JointKind
from butterfly.model.terms import held_by
from butterfly.signals import hold
from butterfly.twin.joint_of_model import JointOfModel, compiled
from butterfly.twin.model_rows import ModelRow, facts_of, model_rows
from butterfly.twin.robot_text import ACTUATOR, DYNAMICS, Edit, TextChange, with_attributes
from butterfly.twin.stand_alone import GRIPS, gripping
from butterfly.twin.twin import NO_DELAY, beyond, listed

_HELD = 1e12
"""Armature of a held joint in kg m^2, or kg."""

_PRECISE = 1e-20
"""Tolerance of MuJoCo's solver, in which the held joints' armatures weigh: angles err by 1e-9."""

_SWITCHED_OFF = (
    mujoco.mjtDisableBit.mjDSBL_CONTACT
    | mujoco.mjtDisableBit.mjDSBL_LIMIT
    | mujoco.mjtDisableBit.mjDSBL_EQUALITY
)


class JointAlone:
    """One joint of a robot's model, which one of its actuators drives, or a torque alone."""

    def __init__(
        self, robot: JointOfModel, pose: Mapping[str, float], actuator: str | None = None
    ) -> None:
        self._model = model = robot.model
        self._data = robot.configured(pose)
        self._dof = int(model.jnt_dofadr[robot.joint])
        self._place = int(model.jnt_qposadr[robot.joint])
        others = np.arange(model.nv) != self._dof
        model.dof_armature[others] = _HELD
        model.dof_frictionloss[others] = 0.0
        model.opt.disableflags |= int(_SWITCHED_OFF)
        model.opt.tolerance = _PRECISE
        self._drive = None if actuator is None else int(model.actuator(actuator).id)
        idle = np.arange(model.nu) != self._drive
        model.actuator_gainprm[idle] = 0.0  # a servo of the joint would hold it
        model.actuator_biasprm[idle] = 0.0

    @property
    def step(self) -> float:
        """The model's time step in s."""
        return float(self._model.opt.timestep)

    def moved(self, commands: Samples, angle: float, velocity: float) -> Samples:
        """Return the (n + 1,) angles before and after each step under (n,) commands.

        They are the actuator's ctrl, else torques in N m.
        """
        model, data = self._model, self._data
        data.qpos[self._place], data.qvel[:] = angle, 0.0
        data.qvel[self._dof] = velocity
        angles = np.empty(commands.size + 1)
        angles[0] = angle
        for k, command in enumerate(commands):
            if self._drive is None:
                data.qfrc_applied[self._dof] = command
            else:
                data.ctrl[self._drive] = command
            mujoco.mj_step(model, data)
            angles[k + 1] = data.qpos[self._place]
        return angles


_STIFF = "0.9999 0.9999 0.001 0.5 2"  # of MuJoCo's impedance: friction does not creep
_OF_URDF = {"damping": "damping", "frictionloss": "friction"}
_DEFAULT = "its default"  # of an attribute that an element does not have: its class's, or 0
_OFF = 0.01  # share of gravity, and rad, by which a file's may differ unsaid


@dataclass(frozen=True, kw_only=True)
class WrittenBack:
    """What was written into a robot's file for one joint or several."""

    changes: tuple[TextChange, ...]
    notes: tuple[str, ...]
    """What the file cannot carry, and what was left as it is."""
    fits: dict[str, tuple[float, float]]
    """FIT in % of each log: of the answer, and of the written model with the others fixed."""
    not_found: tuple[str, ...]
    """Meshes and other files that are not found from the new place."""

    @property
    def sentences(self) -> list[str]:
        """Say what changed, how the written model moves, and what it lacks."""
        lines = [
            f"{change.file.name}:{change.line}  {change.element}  {change.attribute}: "
            f"{_DEFAULT if change.before is None else change.before} to "
            f"{_DEFAULT if change.after is None else change.after}"
            for change in self.changes
        ]
        if self.fits:
            ours, theirs = zip(*self.fits.values(), strict=True)
            worst = min(self.fits, key=lambda name: self.fits[name][1])
            lines.append(
                "Simulated with the logs' inputs, the other joints fixed, the written model has a "
                f"median FIT of {median(theirs):.1f} % (this result: {median(ours):.1f} %; worst "
                f"{min(theirs):.1f} %, {worst})."
            )
        missing = ", ".join(self.not_found)
        return [
            *lines,
            *self.notes,
            *([f"Files not found from the new folder: {missing}."] if missing else []),
        ]


def write_back(
    results: Sequence[Identified], into: Path, out: Path, *, overwrite: bool = False
) -> WrittenBack:
    """Write what was identified into a copy of the robot's file, and move its joints by the logs.

    Raises
    ------
    InputError
        A result has no joint of a model, two have the same joint, the file lacks one of them, or
        ``out`` may not be written (see `butterfly.twin.robot_text.EditedText.write`).
    """
    edits: list[Edit] = []
    notes: list[str] = []
    joints: list[str] = []
    step = float(compiled(into)[1].opt.timestep)
    for result in results:
        facts = facts_of(result)
        if facts is None:
            expected = "a result identified with a model: --model robot.xml --of JOINT"
            raise InputError(result.origin["name"], "model", "nothing", expected)
        if facts.joint in joints:
            raise InputError(result.origin["name"], "joint", facts.joint, "each joint once")
        JointOfModel.of(into, facts.joint)  # names what the file has, if not this joint
        joints.append(facts.joint)
        edits += _edits(facts, result, step)
        notes += [f"{facts.joint}: {note}" for note in _notes(facts, result)]
    edited = with_attributes(into, edits)
    not_found = edited.write(out, overwrite=overwrite)
    fits = {name: pair for result in results for name, pair in _fits(result, out).items()}
    return WrittenBack(changes=edited.changes, notes=tuple(notes), fits=fits, not_found=not_found)


def _written(facts: ModelFacts, result: Identified) -> dict[str, ModelRow]:
    """Return the rows that are written, by attribute: possible, and not what the file says."""
    rows = {row.attribute: row for row in model_rows(result)}
    return {
        name: row
        for name, row in rows.items()
        if row.writes and row.inside is False and row.value >= 0 and _holds(facts, row)
    }


def _holds(facts: ModelFacts, row: ModelRow) -> bool:
    """Whether a file of this kind can hold an attribute."""
    return not facts.urdf or row.attribute in _OF_URDF


def _edits(facts: ModelFacts, result: Identified, step: float) -> Iterator[Edit]:
    """Yield what changes in the file for one joint."""
    rows = _written(facts, result)
    if not facts.urdf:
        joint = _of_joint(facts, result, rows, step)
        if joint:
            yield Edit("joint", facts.joint, joint)
        for actuator in facts.actuators[:1]:
            drive = _of_actuator(actuator, result, rows, step)
            if drive and actuator.name:
                yield Edit(ACTUATOR, actuator.name, drive)
            elif drive:
                yield Edit(ACTUATOR, facts.joint, drive, "joint")
    elif rows:
        some = {_OF_URDF[name]: _number(row.value) for name, row in rows.items()}
        yield Edit(DYNAMICS, facts.joint, some)


def _of_joint(
    facts: ModelFacts, result: Identified, rows: Mapping[str, ModelRow], step: float
) -> dict[str, str | None]:
    """Return the attributes of a joint of MJCF."""
    joint: dict[str, str | None]
    joint = {name: _number(row.value) for name, row in rows.items() if row.element == "joint"}
    drag = result.estimate.parameters.drag if "drag" in result.estimate.names else 0.0
    if drag > 0:
        damping = rows["damping"].value if "damping" in rows else facts.damping
        joint["damping"] = f"{_number(damping)} {_number(drag)}"
    if "damping" in joint:
        joint["springdamper"] = None  # which would override it
    friction = rows["frictionloss"].value if "frictionloss" in rows else facts.frictionloss
    if friction > 0:
        joint["solreffriction"] = f"-1 {_number(gripping(GRIPS[0], step))}"
        joint["solimpfriction"] = _STIFF
    return joint


def _of_actuator(
    actuator: ActuatorFacts, result: Identified, rows: Mapping[str, ModelRow], step: float
) -> dict[str, str | None]:
    """Return the attributes of an actuator of MJCF."""
    drive: dict[str, str | None]
    drive = {name: _number(row.value) for name, row in rows.items() if row.element != "joint"}
    if "forcerange" in drive:
        most = rows["forcerange"].value
        drive["forcerange"] = f"{_number(-most)} {_number(most)}"
    if actuator.by_ratio and ("armature" in rows or "kv" in drive):
        drive = {"kv": _number(actuator.kv / actuator.gear**2)} | drive | {"dampratio": None}
    delay = result.estimate.parameters.delay
    if ("gear" in drive or "kp" in drive) and delay > max(NO_DELAY, step / 2):
        late = max(round(delay / step), 1)
        drive |= {"delay": _number(late * step), "nsample": str(late + 1), "interp": "zoh"}
    return drive


def _number(value: float) -> str:
    """Return a number as a file has it."""
    return f"{value:.6g}"


def _notes(facts: ModelFacts, result: Identified) -> Iterator[str]:
    """Say what the file cannot carry, with its size, and what it keeps."""
    written = _written(facts, result)
    for row in model_rows(result):
        if row.attribute in written:
            continue
        value = f"{row.value:.4g} ± {row.half_width:.2g} {row.unit}"
        if row.inside:
            yield f"{row.attribute} stays {row.now:.4g}, within {value}."
        elif row.value < 0:
            why = "is less than 0: check the masses of the links"
            yield f"{row.attribute} is not written: {value} {why}."
        else:
            yield f"{row.attribute} is not written: {value} has no place in {facts.file}."
    estimate, data = result.estimate, result.data
    if any(log.closed for log in data.logs) and not _servo_of(facts):
        yield f"No set-points are played: {facts.file} has no position actuator with a name there."
    held = {*held_by("model"), *(row.term for row in model_rows(result) if row.writes)}
    if rest := beyond(estimate.parameters, held):
        yield f"The file cannot carry {listed(estimate.parameters, rest, 'unit')}."
    _, moment = facts.bare
    if moment and "p3" in estimate.names and facts.kind is JointKind.HINGE:
        share = estimate.parameters.p3 / moment - 1
        if abs(share) > _OFF:
            more = "more" if share > 0 else "less"
            yield (
                f"Gravity is {100 * abs(share):.2g} % {more} than that of the file's links: "
                f"multiply their masses by {1 + share:.4g} (not written)."
            )


def _fits(result: Identified, path: Path) -> dict[str, tuple[float, float]]:
    """Return the FIT in % of each log: of the answer, and of the written model."""
    facts, data = facts_of(result), result.data
    if facts is None or data.manifest is None:
        return {}
    fits = {}
    for number, (log, entry) in enumerate(zip(data.logs, data.manifest.logs, strict=True)):
        setting = data.simulations.setting(number, result.estimate)
        if not log.integrated and (not log.closed or _servo_of(facts)):
            fits[f"{facts.joint}, {log.name}"] = _fit(path, facts, log, entry, setting)
    return fits


def _servo_of(facts: ModelFacts) -> str | None:
    """Return the name of the joint's position actuator, which set-points command, if it has one."""
    named = (drive.name for drive in facts.actuators[:1] if drive.shortcut == "position")
    return next(named, None)


def _fit(
    path: Path, facts: ModelFacts, log: Log, entry: LogEntry, setting: Setting
) -> tuple[float, float]:
    """Return the FIT in % of a log: of our simulation, and of the written model in its pieces."""
    robot = JointOfModel.of(path, facts.joint)
    pose = entry.pose or {}
    shift = setting.zero - robot.pose_facts(pose).zero if facts.bare[1] else 0.0
    alone, p = JointAlone(robot, pose, _servo_of(facts) if log.closed else None), setting.parameters
    simulation = setting.simulation(log)
    motion = simulation.run(p, setting.zero, setting.velocity)
    if log.closed:
        stamps, commands = log.goal[0], log.goal[1] - shift
    else:
        stamps, commands = log.command[0], p.p4 * p.drive.delivered(log.command[1])
    begins = [grid[0] for grid, *_ in motion.pieces[1:]]
    groups = np.split(log.time, np.searchsorted(log.time, begins))
    moved: list[Samples] = []
    for (grid, angle, velocity), instants in zip(motion.pieces, groups, strict=True):
        count = max(math.ceil((instants[-1] - grid[0]) / alone.step - 1e-9), 1)
        edges = grid[0] + alone.step * np.arange(count + 1)
        torques = hold.mean(stamps, commands, edges - p.delay, log.between_samples)
        angles = alone.moved(torques, angle[0] - shift, velocity[0])
        moved.append(np.interp(instants, edges, angles) + shift)
    with np.errstate(over="ignore", invalid="ignore"):
        ours, theirs = (
            float(np.sqrt(np.mean((some - log.angle) ** 2)))
            for some in (motion.at(log.time), joined(moved))
        )
    return fit_of(ours, log.rms_measured), fit_of(theirs, log.rms_measured)
