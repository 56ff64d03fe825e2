"""One joint of somebody's robot: what its MJCF or URDF says, and what the others do to it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_smoothing_spline
from scipy.optimize import minimize_scalar

from butterfly.arrays import Samples
from butterfly.errors import InputError, listed, nearest
from butterfly.files import require_file
from butterfly.logs.model_facts import ActuatorFacts, LinkMasses, ModelFacts, PoseFacts
from butterfly.model.parameters import JointKind

_MOVES = {
    int(mujoco.mjtJoint.mjJNT_HINGE): JointKind.HINGE,
    int(mujoco.mjtJoint.mjJNT_SLIDE): JointKind.SLIDE,
}
_NO_GRAVITY = 1e-9  # share of the largest torque of gravity that rounding leaves
_VERTICAL = 1e-4  # share of gravity across an axis that a file's digits leave of a vertical one
_SHORTCUTS = {True: "position", False: "velocity"}


def compiled(path: Path) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """Parse and compile an MJCF or URDF; InputError with MuJoCo's own line if it cannot be.

    Meshes that are not there are left out where the file gives the inertia of their body.
    """
    require_file(path, "a model: MJCF (.xml) or URDF")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise _refused(path, error) from None
    try:
        return spec, spec.compile()
    except ValueError as error:
        first = error
    try:
        spec = _without_shapes(mujoco.MjSpec.from_file(str(path)))
        return spec, spec.compile()
    except ValueError:
        raise _refused(path, first) from None


def _refused(path: Path, error: ValueError) -> InputError:
    lines = [text.strip() for text in str(error).splitlines() if text.strip()]
    reason = "; ".join(lines) or "no reason given"  # the second says which element, and where
    return InputError(path, "model", reason, "a model that MuJoCo compiles")


def _without_shapes(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a model without the meshes of bodies whose inertia is given, which weigh nothing."""
    weighing = set()
    for geom in [*spec.geoms]:
        if geom.type != mujoco.mjtGeom.mjGEOM_MESH and not geom.meshname:
            continue
        if geom.parent.explicitinertial or geom.parent.name == "world":
            spec.delete(geom)
        else:
            weighing.add(geom.meshname)
    for mesh in [*spec.meshes]:
        if mesh.name not in weighing:
            spec.delete(mesh)
    for texture in [*spec.textures]:
        spec.delete(texture)
    for material in [*spec.materials]:
        material.textures = [""] * len(material.textures)
    return spec


@dataclass(frozen=True, kw_only=True, eq=False)
class JointOfModel:
    """A compiled model, and the joint that is asked about."""

    path: Path
    spec: mujoco.MjSpec
    model: mujoco.MjModel
    joint: int  # number of the joint

    @classmethod
    def of(cls, path: Path, name: str) -> JointOfModel:
        """Compile a model and find a hinge or slide by name; InputError names what it has."""
        spec, model = compiled(path)
        names = joint_names(model)
        if name not in names:
            raise InputError(path, "joint", name, nearest(name, names) if names else "a joint")
        number = names[name]
        if int(model.jnt_type[number]) not in _MOVES:
            raise InputError(path, "joint", f"{name}, free or ball", "a hinge or a slide")
        robot = cls(path=path, spec=spec, model=model, joint=number)
        robot.require_alone()
        return robot

    @property
    def name(self) -> str:
        """Name of the joint."""
        return str(self.model.joint(self.joint).name)

    @property
    def kind(self) -> JointKind:
        """Hinge or slide."""
        return _MOVES[int(self.model.jnt_type[self.joint])]

    @property
    def others(self) -> dict[str, int]:
        """Numbers of the other hinges and slides, by name."""
        names = joint_names(self.model)
        return {n: k for n, k in names.items() if k != self.joint and self._is_simple(k)}

    @property
    def alike(self) -> dict[str, bool]:
        """The other hinges and slides, and whether each is of this joint's kind."""
        return alike_joints(self.model, self.name)

    def _is_simple(self, number: int) -> bool:
        return int(self.model.jnt_type[number]) in _MOVES

    def require_alone(self) -> None:
        """Raise InputError if the joint cannot be moved without moving others."""
        model, below = self.model, self._below()
        for k in range(model.neq):
            kind = mujoco.mjtEq(int(model.eq_type[k]))  # an array's number is in no set of kinds
            pair = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
            name = model.equality(k).name or f"number {k}"
            if kind == mujoco.mjtEq.mjEQ_JOINT:
                bound = self.joint in pair
            elif kind in {mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD}:
                sites = model.eq_objtype[k] == mujoco.mjtObj.mjOBJ_SITE
                bodies = [int(model.site_bodyid[one]) if sites else one for one in pair]
                bound = (bodies[0] in below) != (bodies[1] in below)
            else:
                bound = False
            if bound and model.eq_active0[k]:
                raise InputError(
                    self.path,
                    f"equality {name}",
                    f"joint {self.name!r} moves others with it",
                    "a joint that moves by itself: its inertia is not that of its links alone",
                )
        for k in range(model.ntendon):
            first, count = model.tendon_adr[k], model.tendon_num[k]
            wraps = range(first, first + count)
            if any(
                model.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT
                and model.wrap_objid[w] == self.joint
                for w in wraps
            ):
                name = model.tendon(k).name or f"number {k}"
                expected = "a joint that no tendon couples to others"
                raise InputError(self.path, f"tendon {name}", f"pulls at {self.name!r}", expected)

    def _below(self) -> set[int]:
        """Return the bodies that the joint moves."""
        model, below = self.model, {int(self.model.jnt_bodyid[self.joint])}
        for body in range(1, model.nbody):  # parents come first
            if int(model.body_parentid[body]) in below:
                below.add(body)
        return below

    def configured(self, pose: Mapping[str, float]) -> mujoco.MjData:
        """Return the state with the other joints at a pose; the rest as the model begins.

        That is at its keyframe ``home``, else at its first, else at zero. InputError for a joint
        that the model does not have.
        """
        model, data = self.model, mujoco.MjData(self.model)
        frames = [model.key(k).name for k in range(model.nkey)]
        if frames:
            frame = frames.index("home") if "home" in frames else 0
            data.qpos[:] = model.key_qpos[frame]
        for name, angle in pose.items():
            if name not in self.others:
                expected = nearest(name, self.others) if self.others else "no other joint"
                raise InputError(self.path, f"pose.{name}", "no such joint", expected)
            data.qpos[model.jnt_qposadr[self.others[name]]] = angle
        return data

    def pose_facts(self, pose: Mapping[str, float]) -> PoseFacts:
        """Return what the joint moves, and how gravity pulls at it, in one pose of the others."""
        model, data = self.model, self.configured(pose)
        dof, place = int(model.jnt_dofadr[self.joint]), int(model.jnt_qposadr[self.joint])
        pulls = []
        for angle in (0.0, math.pi / 2):
            data.qpos[place] = angle
            mujoco.mj_forward(model, data)
            pulls.append(float(data.qfrc_bias[dof] - data.qfrc_gravcomp[dof]))
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        inertia = float(full[dof, dof]) - float(model.dof_armature[dof]) - self._rotors()
        at_zero, at_quarter = pulls
        moment = math.hypot(at_zero, at_quarter) if self.kind is JointKind.HINGE else 0.0
        if moment <= _NO_GRAVITY * self._largest_pull() or not self.gravity_across(pose):
            moment = 0.0
        return PoseFacts(
            pose={name: float(data.qpos[model.jnt_qposadr[k]]) for name, k in self.others.items()},
            inertia=inertia,
            moment=moment,
            zero=math.atan2(-at_zero, at_quarter) if moment else 0.0,
        )

    def _largest_pull(self) -> float:
        """Return the torque in N m of all of the model's weight at one metre."""
        weight = float(np.sum(self.model.body_mass)) * float(np.linalg.norm(self.model.opt.gravity))
        return max(weight, np.finfo(float).tiny)

    def gravity_across(self, pose: Mapping[str, float]) -> float:
        """Return gravity in m/s^2 across the joint's axis; 0 for a slide."""
        if self.kind is JointKind.SLIDE:
            return 0.0
        data = self.configured(pose)
        mujoco.mj_forward(self.model, data)
        axis, pull = data.xaxis[self.joint], self.model.opt.gravity
        if self.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
            return 0.0
        across = float(np.linalg.norm(pull - (pull @ axis) * axis))
        return across if across > _VERTICAL * float(np.linalg.norm(pull)) else 0.0

    def _drives(self) -> Iterator[int]:
        """Yield the numbers of the actuators of the joint."""
        kinds = {mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT}
        for k in range(self.model.nu):
            kind = mujoco.mjtTrn(int(self.model.actuator_trntype[k]))
            if kind in kinds and self.model.actuator_trnid[k, 0] == self.joint:
                yield k

    def _rotors(self, values: NDArray[np.float64] | None = None) -> float:
        """Return what actuators add at the joint: their armature, or (nu,) other values."""
        model = self.model
        added = model.actuator_armature if values is None else values
        return float(sum(model.actuator_gear[k, 0] ** 2 * added[k] for k in self._drives()))

    def _actuators(self) -> Iterator[ActuatorFacts]:
        model = self.model
        for k in self._drives():
            gear, gain = float(model.actuator_gear[k, 0]), float(model.actuator_gainprm[k, 0])
            _, stiffness, damping = map(float, model.actuator_biasprm[k, :3])
            shortcut = "motor"
            if model.actuator_biastype[k] == mujoco.mjtBias.mjBIAS_AFFINE:
                shortcut = _SHORTCUTS[stiffness != 0]
                shortcut = shortcut if stiffness in {0.0, -gain} else "general"
            elif model.actuator_biastype[k] != mujoco.mjtBias.mjBIAS_NONE:
                shortcut, stiffness, damping = "general", 0.0, 0.0
            else:
                stiffness, damping = 0.0, 0.0
            limited = bool(model.actuator_forcelimited[k])
            force = float(np.abs(model.actuator_forcerange[k]).max()) * abs(gear)
            yield ActuatorFacts(
                name=str(model.actuator(k).name),
                gear=gear,
                gain=gear * gain,
                kp=0.0 - gear**2 * stiffness,
                kv=0.0 - gear**2 * damping,
                effort=force if limited else None,
                shortcut=shortcut,
                # where MuJoCo's parser has put a ratio, until it compiles
                by_ratio=float(self.spec.actuators[k].biasprm[2]) > 0,
            )

    def facts(self, poses: Sequence[PoseFacts], links: LinkMasses) -> ModelFacts:
        """Return what the model says of the joint, in some poses of the others (`pose_facts`)."""
        model, number = self.model, self.joint
        dof = int(model.jnt_dofadr[number])
        distinct = [pose for k, pose in enumerate(poses) if pose not in poses[:k]]
        limited = bool(model.jnt_limited[number])
        low, high = map(float, model.jnt_range[number])
        clipped = bool(model.jnt_actfrclimited[number])
        return ModelFacts(
            file=self.path.name,
            urdf=self.path.suffix.lower() == ".urdf" or is_urdf(self.path),
            joint=self.name,
            kind=self.kind,
            gravity=max(self.gravity_across(pose.pose) for pose in distinct),
            poses=distinct,
            range=(low, high) if limited else None,
            armature=float(model.dof_armature[dof]),
            rotors=self._rotors(),
            damping=float(np.ravel(model.dof_damping[dof])[0]),
            motor_damping=self._rotors(np.asarray(model.actuator_damping)),
            frictionloss=float(model.dof_frictionloss[dof]),
            stiffness=float(np.ravel(model.jnt_stiffness[number])[0]),
            effort=float(np.abs(model.jnt_actfrcrange[number]).max()) if clipped else None,
            actuators=[*self._actuators()],
            others=[*self.others],
            links=links,
            warnings=[*self._warnings()],
        )

    def _warnings(self) -> Iterator[str]:
        """Say what the model has that one joint alone does not."""
        model = self.model
        free = [k for k in range(model.njnt) if not self._is_simple(k)]
        if free:
            names = listed([model.joint(k).name or f"joint {k}" for k in free])
            yield f"{names} (free or ball) is assumed to be held in the model's initial pose."
        if model.jnt_stiffness[self.joint].any():
            yield f"The model has a spring at {self.name!r}; the term spring fits it to the logs."


def joint_names(model: mujoco.MjModel) -> dict[str, int]:
    """Return the numbers of a model's joints that have a name."""
    names = {str(model.joint(k).name): k for k in range(model.njnt)}
    return {name: number for name, number in names.items() if name}


def moving_joints(model: mujoco.MjModel) -> dict[str, int]:
    """Return the same of hinges and slides alone."""
    names = joint_names(model)
    return {name: k for name, k in names.items() if int(model.jnt_type[k]) in _MOVES}


def alike_joints(model: mujoco.MjModel, name: str) -> dict[str, bool]:
    """Return a model's hinges and slides besides one, and whether each is of its kind."""
    joints = moving_joints(model)
    kind = model.jnt_type[joints.pop(name)]
    return {other: bool(model.jnt_type[k] == kind) for other, k in joints.items()}


def is_urdf(path: Path) -> bool:
    """Whether the root element of a file is that of a URDF."""
    head = path.read_bytes()[:4096]
    return b"<robot" in head


_STANDS_OUT = 0.3  # of the noise, rms: a smoothed motion that is less is part of the noise
_STRETCH = 1200  # samples by which the smoothness is chosen
_DECADES = (-9.0, 9.0)  # of the smoothness, over the cube of the sampling interval in s


@dataclass(frozen=True, kw_only=True)
class JointMotion:
    """Positions, velocities and accelerations of a joint, (n,) each."""

    position: Samples
    velocity: Samples
    acceleration: Samples

    @classmethod
    def of(cls, time: Samples, measured: Samples, at: Samples) -> JointMotion:
        """Return the motion ``at`` (n,) times that a smoothing spline finds in measured positions.

        They are (m,) at their own times. What does not stand out of their noise is no motion.
        """
        spline = make_smoothing_spline(time, measured, lam=smoothness(time, measured))
        smooth = spline(time)
        if np.std(smooth) <= _STANDS_OUT * np.std(measured - smooth):
            still = np.zeros(at.size)
            return cls(position=still + np.mean(measured), velocity=still, acceleration=still)
        velocity, acceleration = (spline.derivative(order)(at) for order in (1, 2))
        return cls(position=spline(at), velocity=velocity, acceleration=acceleration)

    @property
    def reach(self) -> float:
        """Half of the way between its ends."""
        return float(np.ptp(self.position)) / 2


def smoothness(time: Samples, measured: Samples) -> float:
    """Return the smoothness with which every other sample predicts those between best.

    It is chosen on the part of a long record that moves most.
    """
    starts = range(0, max(time.size - _STRETCH, 0) + 1, max(_STRETCH // 2, 1))
    first = max(starts, key=lambda start: float(np.std(measured[start : start + _STRETCH])))
    some = slice(first, first + _STRETCH)
    t, y = time[some] - time[first], measured[some]
    step = float(np.mean(np.diff(t)))

    def error(decades: float) -> float:
        spline = make_smoothing_spline(t[::2], y[::2], lam=10.0**decades * step**3)
        return float(np.mean((spline(t[1::2]) - y[1::2]) ** 2))

    best = minimize_scalar(error, bounds=_DECADES, method="bounded", options={"xatol": 0.1})
    return float(10.0**best.x * step**3)


def coupling(
    robot: JointOfModel,
    driven: JointMotion,
    others: Mapping[str, JointMotion],
    pose: Mapping[str, float],
) -> Samples:
    """Return the (n,) torque in N m that the others' motion takes from the joint's drive.

    ``others``: by name; joints that are not among them stand still at their ``pose``. Armature,
    damping and friction of the others act on themselves alone.
    """
    model, data = robot.model, robot.configured(pose)
    alone, numbers = robot.pose_facts(pose), robot.others
    dof = int(model.jnt_dofadr[robot.joint])
    moving = {robot.joint: driven} | {numbers[name]: motion for name, motion in others.items()}
    places = {k: (int(model.jnt_qposadr[k]), int(model.jnt_dofadr[k])) for k in moving}
    torques, result = np.empty(driven.position.size), np.zeros(model.nv)
    for k in range(driven.position.size):
        for number, (place, at) in places.items():
            motion = moving[number]
            data.qpos[place] = motion.position[k]
            data.qvel[at] = motion.velocity[k]
            data.qacc[at] = motion.acceleration[k]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_rne(model, data, 1, result)
        torques[k] = result[dof] - data.qfrc_gravcomp[dof]
    by_itself = alone.inertia * driven.acceleration
    if robot.kind is JointKind.HINGE:
        by_itself = by_itself + alone.moment * np.sin(driven.position - alone.zero)
    return np.asarray(torques - by_itself)
