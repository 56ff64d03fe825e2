"""Joints with a short log of their own, and plain MuJoCo that moves whatever holds them."""

from xml.etree import ElementTree

import numpy as np

from butterfly.identification.free_run import Setting
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass, JointKind, LumpedParameters
from butterfly.twin.twin import Twin
from tests.plant.setting import mujoco_alone

STEP = 0.002
DRIVEN = 0.4 * np.sin(5 * STEP * np.arange(1000)) + 0.2 * np.sin(9 * STEP * np.arange(1000))
PARAMETERS = {"p1": 0.003, "p2": 2e-3, "p3": 0.05, "p4": 0.04}
MASS = AddedMass(mass=0.05, arm=0.1)
KINDS = {
    "smooth": {},
    "delayed": {"delay": 0.0031, "drag": 1e-4, "spring": 0.01},
    "motor": {"back_emf": 1e-3, "coulomb": 2e-3, "p3_offset": 4e-3, "tilt": 0.3},
    "sticking": {"coulomb": 2e-3, "stribeck": 2e-3, "bias": 1e-3},
    "slide": {"p1": 1.5, "p2": 2.0, "p3": 0.0, "p4": 8.0, "spring": 20.0},
}
"""Terms of joints, the last a slide."""


def twin(kind="smooth", /, added=MASS, parameters=None, **more):
    """A joint of a kind with a log of two seconds, at whose steps its command changes."""
    terms = PARAMETERS | KINDS[kind]
    joint = JointKind.SLIDE if kind == "slide" else JointKind.HINGE
    carried = AddedMass(mass=added.mass, arm=added.arm, joint=joint)
    parameters = parameters or LumpedParameters(**terms)
    time = STEP * np.arange(DRIVEN.size)
    log = Log(time, input=DRIVEN, angle=0 * time, added_mass=carried, name="two sines")
    setting = Setting(parameters=parameters, zero=0.0, velocity=0.0)
    made = {"name": f"My joint, {kind}", "recorded": lambda: [(log, setting)], "joint": joint}
    return Twin(**made | {"parameters": parameters, "added": carried} | more)


def moved(model, driven=DRIVEN, by="ctrl", which=0):
    """(n + 1,) angles of the joint of a model that is driven by one of its inputs."""
    joint = model.jnt_qposadr[model.actuator_trnid[which, 0]] if by == "ctrl" else 0
    return mujoco_alone(model, driven, by=by, which=which, joint=joint)[0][:, 0]


def parsed(text):
    """The XML of lines that have no root of their own, or of a file."""
    lines = text.replace('<?xml version="1.0"?>', "")
    return ElementTree.fromstring(f"<lines>{lines}</lines>")  # noqa: S314 - our own


def ours(joint):
    """(n,) angles of our own simulation of its log."""
    ((log, setting),) = joint.recorded()
    fine = Simulation(log, joint.parameters, longest=1e-3)
    return fine.run(setting.parameters, 0.0, 0.0).at(log.time)


def acceleration(p, angle, velocity, torque):
    """What the equation says in rad/s² of a joint that slides in its friction."""
    friction = p.p2 * velocity + p.coulomb * np.sign(velocity)
    gravity = p.p3 * np.sin(angle) + p.p3_offset * np.cos(angle)
    return (torque - friction - gravity) / p.p1
