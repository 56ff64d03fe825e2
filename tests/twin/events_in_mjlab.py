"""Draws by the events of a module in mjlab, of whose environment it is run.

Reads JSON from standard input: text of the module, class and fields of an actuator, MJCF of a body
and a number of environments; writes the values of the joint's model in each.
"""

import inspect
import json
import sys
from types import SimpleNamespace

import mujoco
import torch
from mjlab import actuator, entity, sim

FIELDS = ("dof_armature", "dof_damping", "dof_frictionloss", "actuator_gainprm")


def main():
    """Draw once in each environment."""
    asked, made = json.load(sys.stdin), {}
    exec(asked["text"], made)  # noqa: S102 - our own
    fields = asked["fields"] | made["OF_MJLAB_ACTUATOR"]
    drive = getattr(actuator, asked["class"])(**fields)
    robot = entity.EntityCfg(
        spec_fn=lambda: mujoco.MjSpec.from_string(asked["body"]),
        articulation=entity.EntityArticulationInfoCfg(actuators=(drive,)),
    ).build()
    simulation = sim.Simulation(
        asked["count"], sim.SimulationCfg(), model=robot.spec.compile(), device="cpu"
    )
    robot.initialize(simulation.mj_model, simulation.model, simulation.data, "cpu")
    simulation.expand_model_fields((*FIELDS, "actuator_biasprm", "actuator_forcerange"))
    env = SimpleNamespace(
        scene={"robot": robot}, sim=simulation, num_envs=asked["count"], device="cpu"
    )
    for event in made["mjlab_events"]().values():
        event.params["asset_cfg"].resolve(env.scene)
        inspect.signature(event.func).bind(env, None, **event.params)
        event.func(env, None, **event.params)
    drawn = {name: torch.as_tensor(getattr(simulation.model, name)).tolist() for name in FIELDS}
    json.dump(drawn, sys.stdout)


if __name__ == "__main__":
    main()
