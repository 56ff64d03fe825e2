"""A robot's file, and logs of the robot itself, which is not quite as its file says.

    python -m examples.arm_logs --out FOLDER

writes FOLDER/arm.xml (models/arm) and FOLDER/logs: the elbow, the shoulder and the wrist of that
arm are driven one after the other by a torque, in three runs of 10 s each. Motors hold the other
joints, softly, as real ones do. Each log has the positions of all joints. What MuJoCo moves has
another armature, damping and friction than the file: ROBOT.
"""

from __future__ import annotations

import argparse
import csv
import shutil
from pathlib import Path

import mujoco
import numpy as np

ARM = Path(__file__).parents[1] / "models/arm/arm.xml"
ROBOT = {  # armature in kg m², damping in N m s/rad, friction in N m
    "shoulder": (0.061, 0.31, 0.52),
    "elbow": (0.026, 0.11, 0.26),
    "wrist": (0.0125, 0.034, 0.061),
}
FORCE = {"shoulder": 0.7, "elbow": 0.6, "wrist": 0.14}  # N m, of each of four sines
POSE = {"pan": 0.0, "shoulder": 1.2, "elbow": 0.3, "wrist": 0.1, "roll": 0.0}  # rad
STEP, RATE, SECONDS = 5e-4, 200, 10.0  # s, Hz, s
NOISE = 3e-4  # rad, of an encoder
HOLD, BRAKE = 120.0, 4.0  # N m/rad and N m s/rad with which motors hold the others


def robot() -> mujoco.MjModel:
    """Return the arm as it is."""
    model = mujoco.MjModel.from_xml_path(str(ARM))
    model.opt.timestep = STEP
    model.actuator_gainprm[:] = model.actuator_biasprm[:] = 0.0  # torques are applied here
    model.dof_solref[:] = -1.0, -2.0 / (0.12 * STEP)  # dry friction that grips within a step
    for name, (armature, damping, friction) in ROBOT.items():
        dof = model.joint(name).dofadr[0]
        model.dof_armature[dof], model.dof_damping[dof] = armature, damping
        model.dof_frictionloss[dof] = friction
    return model


def run(model: mujoco.MjModel, name: str, seed: int) -> list[list[float]]:
    """Drive one joint about where it hangs; return the rows of a log."""
    rng, data = np.random.default_rng(seed), mujoco.MjData(model)
    goal = np.array([POSE[model.joint(k).name] for k in range(model.njnt)])
    data.qpos[:] = goal
    joint = model.joint(name).id
    model.qpos_spring[:] = goal
    model.jnt_stiffness[:] = np.where(np.arange(model.njnt) == joint, 0.0, HOLD)
    model.dof_damping[:] = np.where(np.arange(model.nv) == joint, ROBOT[name][1], BRAKE)
    pace, phase = rng.uniform(2.0, 14.0, 4), rng.uniform(0.0, 2 * np.pi, 4)
    rows = []
    for k in range(round(SECONDS * RATE)):
        driven = FORCE[name] * np.sin(pace * k / RATE + phase).sum()
        torque = driven + 1.5 * (goal[joint] - data.qpos[joint])
        rows.append([k / RATE, torque, *(data.qpos + rng.normal(0.0, NOISE, model.nq))])
        data.qfrc_applied[joint] = torque
        mujoco.mj_step(model, data, round(1 / RATE / STEP))
    return rows


def main() -> None:
    """Write the file of the arm, and its logs."""
    parser = argparse.ArgumentParser(description="Logs of an arm, joint by joint.")
    parser.add_argument("--out", type=Path, required=True)
    out = parser.parse_args().out
    (out / "logs").mkdir(parents=True, exist_ok=True)
    shutil.copy(ARM, out / "arm.xml")
    model = robot()
    positions = [f"{model.joint(k).name}_position" for k in range(model.njnt)]
    for number, name in enumerate(ROBOT):
        for seed in range(3):
            with (out / "logs" / f"{name}_{seed + 1}.csv").open("w", newline="") as file:
                writer = csv.writer(file)
                writer.writerow(["time", f"{name}_torque", *positions])
                for row in run(model, name, 10 * number + seed):
                    writer.writerow([f"{value:.6g}" for value in row])


if __name__ == "__main__":
    main()
