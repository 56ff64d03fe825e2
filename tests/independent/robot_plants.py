"""Whole robots stepped by MuJoCo, one joint of which a command drives, without the program.

A plant is built anew from a compiled model: its bodies, masses and joint axes, in one pose. A joint
that is held exactly is no joint of it, so that no soft constraint holds it. One that is held softly
has a spring and a damper; one that is moved has them about a place that wanders.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import mujoco
import numpy as np

STEP = 0.5e-3
"""Step in s of the fourth-order Runge-Kutta method."""

_PER_STEP = 2.0 / 0.12  # damping of friction's constraint, over the step's inverse
_STIFF = {"solref": (-1.0, -_PER_STEP / STEP), "solimp": (0.9999, 0.9999, 0.001, 0.5, 2.0)}
_FINER = 8  # parts of a step about rest
_SETTLING = 1.0  # s before a log begins


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """What the joint has and its file does not say."""

    armature: float  # kg m^2, with that of the actuators
    damping: float
    frictionloss: float
    stiff: bool = True
    """Whether friction is as stiff as the step allows; otherwise as MuJoCo has it by default."""
    masses: float = 1.0
    """Factor of all links' masses and inertias."""


@dataclass(frozen=True, kw_only=True)
class Hold:
    """A spring and a damper that hold another joint where ``place`` says, at a time in s."""

    stiffness: float
    damping: float
    place: Callable[[float], float]
    rate: Callable[[float], float] | None = None
    """Derivative of the place; None where it never moves."""


@dataclass(frozen=True, kw_only=True)
class Encoder:
    """Readings are multiples of ``count`` rad, of an angle with white noise."""

    count: float
    spread: float

    def read(self, rng, angle):
        """Return what is read of angles."""
        noisy = angle + rng.normal(0.0, self.spread, np.shape(angle))
        return self.count * np.round(noisy / self.count)


@dataclass(frozen=True, kw_only=True)
class Timing:
    """In steps of the plant."""

    period: int
    delay: int
    samples: int


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A log, and what truly moved."""

    time: np.ndarray
    input: np.ndarray
    angle: np.ndarray
    """As the encoder read it."""
    true: np.ndarray
    others: dict[str, np.ndarray] = field(default_factory=dict)
    """True positions of the other joints that are not held exactly."""


class Plant:
    """A robot in a pose: the joint, and those of the others that are not held exactly."""

    def __init__(self, model, pose, joint, hidden, *, holds=None, passive=()):
        self._holds = holds or {}
        self._pose = pose
        moving = {joint, *self._holds, *passive}
        self.model = built(model, pose, moving, hidden, joint).compile()
        self._data = mujoco.MjData(self.model)
        self._joint = joint
        self._dof = self._place(joint)
        self._stiff = hidden.stiff
        self._slow = 2.0 * STEP * hidden.frictionloss / hidden.armature if hidden.armature else 0.0
        for name, hold in self._holds.items():
            self.model.jnt_stiffness[self.model.joint(name).id] = hold.stiffness
            self.model.dof_damping[self._place(name)] = hold.damping

    def _place(self, name):
        return int(self.model.joint(name).dofadr[0])

    def inertias(self):
        """Return the diagonal of the mass matrix, with armature, in the pose, by joint."""
        self._reset(self._pose[self._joint])
        full = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self._data, full)
        return {self.model.joint(k).name: float(full[k, k]) for k in range(self.model.nv)}

    def torque(self, angle):
        """Return what gravity and springs ask of the joint where it rests at an angle in rad."""
        self._reset(angle)
        return float(self._data.qfrc_bias[self._dof])

    def _reset(self, angle):
        data = self._data
        mujoco.mj_resetData(self.model, data)
        data.qpos[:] = [self._pose[self.model.joint(k).name] for k in range(self.model.nv)]
        data.qpos[self._dof] = angle
        mujoco.mj_forward(self.model, data)

    def run(self, rng, law, start, encoder, timing):
        """Return the log of a law: from a number of sample and a reading to a command in N m.

        The joint rests at ``start`` before. A command acts ``delay`` after its sample, until the
        next one does.
        """
        model, data, dof = self.model, self._data, self._dof
        self._reset(start)
        held = [(self._place(name), hold) for name, hold in self._holds.items()]
        still = [pair for pair in held if pair[1].rate is None]
        moved = [pair for pair in held if pair[1].rate is not None]
        bias = data.qfrc_bias.copy()
        for place, hold in still:
            data.qfrc_applied[place] = bias[place] + hold.stiffness * hold.place(0.0)
        late, rest = divmod(timing.delay, timing.period)
        settling = round(_SETTLING / (timing.period * STEP))
        count = timing.samples + settling
        commands, readings = np.empty(count), np.empty(count)
        true, others = np.empty(count), np.empty((count, model.nv))
        for k in range(count):
            others[k], true[k] = data.qpos, data.qpos[dof]
            readings[k] = encoder.read(rng, true[k])
            commands[k] = law(k - settling, readings[k])
            for steps, sent in ((rest, k - late - 1), (timing.period - rest, k - late)):
                data.qfrc_applied[dof] = commands[max(sent, 0)]
                for _ in range(steps):
                    for place, hold in moved:
                        pull = hold.stiffness * hold.place(data.time - _SETTLING)
                        pull += hold.damping * hold.rate(data.time - _SETTLING)
                        data.qfrc_applied[place] = bias[place] + pull
                    self._step()
        used = slice(settling, None)
        names = [model.joint(k).name for k in range(model.nv)]
        return Recording(
            time=STEP * timing.period * np.arange(timing.samples),
            input=commands[used],
            angle=readings[used],
            true=true[used],
            others={name: others[used, k] for k, name in enumerate(names) if name != self._joint},
        )

    def _step(self):
        """Step once, in finer steps where the joint may come to rest within the step."""
        model, data = self.model, self._data
        finer = self._stiff and abs(data.qvel[self._dof]) < self._slow
        parts = _FINER if finer else 1
        model.opt.timestep = STEP / parts
        if self._stiff:
            model.dof_solref[self._dof, 1] = -_PER_STEP * parts / STEP
        mujoco.mj_step(model, data, parts)


def built(model, pose, moving, hidden, joint):
    """Return the description of a model in which only some joints move, in a pose of all."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
    spec.option.gravity, spec.option.tolerance = model.opt.gravity, 1e-14
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    for name, angle in pose.items():
        data.qpos[model.joint(name).qposadr] = angle
    mujoco.mj_kinematics(model, data)
    bodies = [spec.worldbody]
    for k in range(1, model.nbody):
        parent = int(model.body_parentid[k])
        numbers = model.body_jntadr[k] + np.arange(model.body_jntnum[k])
        free = [int(n) for n in numbers if model.joint(n).name in moving]
        place, turn = model.body_pos[k], model.body_quat[k]
        if not free:
            place, turn = _between(data, parent, k)
        body = bodies[parent].add_body(name=model.body(k).name, pos=place, quat=turn)
        bodies.append(body)
        body.explicitinertial = True
        body.mass = hidden.masses * model.body_mass[k]
        body.inertia = hidden.masses * model.body_inertia[k]
        body.ipos, body.iquat = model.body_ipos[k], model.body_iquat[k]
        for number in free:
            _add_joint(body, model, number, hidden if model.joint(number).name == joint else None)
    for k in range(model.neq):
        ends = [model.body(n).name for n in (model.eq_obj1id[k], model.eq_obj2id[k])]
        if model.eq_type[k] == mujoco.mjtEq.mjEQ_CONNECT and _loose(bodies, moving):
            added = spec.add_equality(type=mujoco.mjtEq.mjEQ_CONNECT)
            added.objtype = mujoco.mjtObj.mjOBJ_BODY
            added.name1, added.name2 = ends
            added.data[:3] = model.eq_data[k, :3]
            added.solref, added.solimp = model.eq_solref[k], model.eq_solimp[k]
    return spec


def _loose(bodies, moving):
    return len(bodies) > 1 and len(moving) > 1


def _between(data, parent, body):
    """Return place and quaternion of a body in its parent's frame, where both are."""
    back, place, turn = np.empty(4), np.empty(3), np.empty(4)
    mujoco.mju_negQuat(back, data.xquat[parent])
    mujoco.mju_rotVecQuat(place, data.xpos[body] - data.xpos[parent], back)
    mujoco.mju_mulQuat(turn, back, data.xquat[body])
    return place, turn


def _add_joint(body, model, number, hidden):
    """Add a joint as the model has it, or as it is in truth."""
    dof = int(model.jnt_dofadr[number])
    joint = body.add_joint(name=model.joint(number).name, type=model.jnt_type[number])
    joint.pos, joint.axis = model.jnt_pos[number], model.jnt_axis[number]
    joint.ref = model.qpos0[model.jnt_qposadr[number]]
    if hidden is None:
        joint.armature, joint.damping[0] = model.dof_armature[dof], model.dof_damping[dof]
        return
    joint.armature, joint.frictionloss = hidden.armature, hidden.frictionloss
    joint.damping[0] = hidden.damping
    if hidden.stiff:
        joint.solref_friction, joint.solimp_friction = _STIFF["solref"], _STIFF["solimp"]
