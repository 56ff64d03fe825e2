"""Moves one joint in mjlab, of whose environment it is run: it knows nothing of this project.

Reads JSON from standard input: class and fields of an actuator, MJCF of a body, step and commands;
writes the angles before each step.
"""

import json
import sys

import mujoco
import torch
from mjlab import actuator, entity, sim


def main():
    """Move it."""
    asked = json.load(sys.stdin)
    fields = asked["fields"]
    if "motor_params" in fields:
        fields["motor_params"] = actuator.DcMotorPhysicalParams(**fields["motor_params"])
    drive = getattr(actuator, asked["class"])(**fields)
    robot = entity.EntityCfg(
        spec_fn=lambda: mujoco.MjSpec.from_string(asked["body"]),
        articulation=entity.EntityArticulationInfoCfg(actuators=(drive,)),
    ).build()
    settings = sim.SimulationCfg(mujoco=sim.MujocoCfg(timestep=asked["step"]))
    simulation = sim.Simulation(1, settings, model=robot.spec.compile(), device="cpu")
    robot.initialize(simulation.mj_model, simulation.model, simulation.data, "cpu")
    set_target = getattr(robot, f"set_joint_{asked['target']}_target")
    angles = []
    for command in asked["commands"]:
        angles.append(float(robot.data.joint_pos[0, 0]))
        set_target(torch.tensor([[command]]))
        robot.write_data_to_sim()
        simulation.step()
        robot.update(asked["step"])
    json.dump({"mujoco": mujoco.__version__, "angles": angles}, sys.stdout)


if __name__ == "__main__":
    main()
