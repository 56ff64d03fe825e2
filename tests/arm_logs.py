"""Logs of one joint of the shipped arm, moved by MuJoCo with values that its file does not have."""

import mujoco
import numpy as np

from butterfly.files import shipped
from butterfly.twin.joint_of_model import JointOfModel

ARM = shipped("models/arm/arm.xml")
TRUTH = {"armature": 0.03, "damping": 0.12, "frictionloss": 0.15}
"""Of the joint that moves: the file's elbow has .02, .08 and .2."""

STEP, RATE, NOISE = 5e-4, 200, 5e-4  # s, Hz, rad
_HELD = 1e12  # armature of the others, which nothing moves then


def write_log(
    path, joint, pose, *, seed=0, seconds=6.0, columns=(), swing=0.0, gain=1.0, force=0.6
):
    """Move a joint about where it hangs; the log has the positions of others in ``columns``.

    ``swing``: rad by which a motor moves each other joint to and fro; ``gain``: N m for each unit
    of the recorded input; ``force``: N m, of each of the four sines that drive it.
    """
    rng = np.random.default_rng(seed)
    robot = JointOfModel.of(ARM, joint)
    model, data = robot.model, robot.configured(pose)
    model.opt.timestep, model.opt.tolerance = STEP, 1e-20
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    dof, place = int(model.jnt_dofadr[robot.joint]), int(model.jnt_qposadr[robot.joint])
    model.actuator_gainprm[:] = model.actuator_biasprm[:] = 0.0
    others = np.arange(model.nv) != dof
    model.dof_armature[others], model.dof_frictionloss[others] = (0.3 if swing else _HELD), 0.0
    model.dof_armature[dof] = TRUTH["armature"]
    model.dof_damping[dof] = TRUTH["damping"]
    model.dof_frictionloss[dof] = TRUTH["frictionloss"]
    model.dof_solref[dof] = [-1, -2 / (0.12 * STEP)]
    home, facts = data.qpos.copy(), robot.pose_facts(pose)
    middle = facts.zero + 0.2 if facts.moment else 0.0
    data.qpos[place] = middle
    pace, phase = rng.uniform(2.0, 14.0, 4), rng.uniform(0.0, 6.3, 4)
    slow, rows = rng.uniform(0.8, 2.5, model.nv), []
    every = round(1 / RATE / STEP)
    for k in range(round(seconds * RATE)):
        time = k / RATE
        torque = force * np.sin(pace * time + phase).sum() - 0.05 * data.qvel[dof]
        torque += 1.5 * (middle - data.qpos[place])
        torque += facts.moment * np.sin(middle - facts.zero)
        angles = data.qpos + rng.normal(0.0, NOISE, model.nq)
        seen = [angles[model.jnt_qposadr[robot.others[name]]] for name in columns]
        rows.append([time, torque / gain, angles[place], *seen])
        goal = home + swing * np.sin(slow * time)
        data.qfrc_applied[:] = swing and 200.0 * (goal - data.qpos) - 20.0 * data.qvel
        data.qfrc_applied[dof] = torque
        mujoco.mj_step(model, data, every)
    names = ["time", f"{joint}_torque", f"{joint}_position", *(f"{n}_position" for n in columns)]
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="")


def write_logs(folder, joint, poses, **options):
    """Write a log for each pose of the other joints, and return the folder."""
    folder.mkdir(exist_ok=True, parents=True)
    for k, pose in enumerate(poses):
        write_log(folder / f"{k}.csv", joint, pose, seed=k, **options)
    return folder


SERVO = {"kp": 14.0, "kv": 0.6, "forcerange": 0.7}
"""Of the servo that moves the wrist: the file has 20, 0.4 and 1."""


def write_servo_log(path, pose, *, seed=0, seconds=6.0):
    """Let the wrist's position actuator follow set-points, and record them with its angle.

    Steps are so large that its torque is limited.
    """
    rng = np.random.default_rng(seed)
    robot = JointOfModel.of(ARM, "wrist")
    model, data = robot.model, robot.configured(pose)
    model.opt.timestep, model.opt.tolerance = STEP, 1e-20
    dof, place = int(model.jnt_dofadr[robot.joint]), int(model.jnt_qposadr[robot.joint])
    others = np.arange(model.nv) != dof
    model.dof_armature[others], model.dof_frictionloss[others] = _HELD, 0.0
    model.dof_armature[dof], model.dof_damping[dof] = TRUTH["armature"], TRUTH["damping"]
    model.dof_frictionloss[dof] = TRUTH["frictionloss"]
    model.dof_solref[dof] = [-1, -2 / (0.12 * STEP)]
    drive = int(model.actuator("wrist").id)
    model.actuator_gainprm[:], model.actuator_biasprm[:] = 0.0, 0.0
    model.actuator_gainprm[drive, 0] = SERVO["kp"]
    model.actuator_biasprm[drive, 1:3] = -SERVO["kp"], -SERVO["kv"]
    model.actuator_forcerange[drive] = -SERVO["forcerange"], SERVO["forcerange"]
    data.qpos[place] = middle = 0.2
    pace, phase, rows = rng.uniform(2.0, 12.0, 3), rng.uniform(0.0, 6.3, 3), []
    steps = rng.uniform(-0.5, 0.5, int(seconds) + 1)
    every = round(1 / RATE / STEP)
    for k in range(round(seconds * RATE)):
        time = k / RATE
        goal = middle + 0.12 * np.sin(pace * time + phase).sum() + steps[int(time)]
        rows.append([time, goal, data.qpos[place] + rng.normal(0.0, NOISE)])
        data.ctrl[drive] = goal
        mujoco.mj_step(model, data, every)
    names = "time,wrist_goal_position,wrist_position"
    np.savetxt(path, rows, delimiter=",", header=names, comments="")
