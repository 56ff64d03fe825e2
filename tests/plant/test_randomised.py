"""Models of draws move as the grey box does with the same parameters."""

import mujoco
import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.model.greybox import simulate
from butterfly.model.parameters import LumpedParameters
from butterfly.plant.randomised import models
from butterfly.plant.twin import MASS, twin
from tests.conftest import MASSES


def _parameters(seed, **more):
    factor = 1 + 0.1 * np.random.default_rng(seed).standard_normal(5)
    values = factor * np.array([0.003, 1e-3, 0.04, 0.5, 8e-4])
    return LumpedParameters(
        **dict(zip(("p1", "p2", "p3", "p4", "coulomb"), values, strict=True)), **more
    )


def _run(text, angle, commands):
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[0] = angle
    angles = [angle]
    for command in commands:
        data.ctrl[0] = command
        mujoco.mj_step(model, data)
        angles.append(data.qpos[0])
    return model.opt.timestep, np.array(angles)


def test_each_model_moves_as_the_grey_box_with_its_draw():
    drawn = [_parameters(seed, drag=1e-5 * seed, bias=1e-3) for seed in range(4)]
    commands = 0.02 * np.sin(5e-3 * np.arange(8000))
    ends = []
    for parameters, text in zip(drawn, models(drawn, MASSES[1]), strict=True):
        step, angles = _run(text, 0.3, commands)
        time = step * np.arange(angles.size)
        held = np.repeat(commands[:, None], 3, axis=1)
        expected, _ = simulate(parameters.with_added_mass(MASSES[1]), time, held, 0.3)
        assert np.abs(angles - expected).max() < 2e-3
        ends.append(expected[-1])
    assert np.ptp(ends) > 1e-2


def test_a_hand_too_light_for_its_parameters_is_made_heavier_or_refused():
    ordinary = LumpedParameters(p1=0.012, p2=0.02, p3=0.62, p4=1.0)
    lumped = twin(ordinary).lumped
    assert (lumped.p1, lumped.p3) == pytest.approx((0.012, 0.62))
    assert twin(_parameters(0)).hand.mass == MASS
    (text,) = models([ordinary])
    mujoco.MjModel.from_xml_string(text)
    with pytest.raises(InputError, match=r"--hand-mass.*more than 0\.333 kg"):
        twin(ordinary, 0.3)


def test_friction_that_is_larger_at_rest_needs_bristles():
    drawn = [_parameters(0, stribeck=3e-4), _parameters(1)]
    with pytest.raises(InputError, match="bristles"):
        list(models(drawn))
    first, second = models(drawn, bristle_stiffness=10.0)
    assert "lugre" in first
    assert "lugre" not in second
    commands = 0.02 * np.sin(5e-3 * np.arange(8000))
    step, angles = _run(first, 0.3, commands)
    held = np.repeat(commands[:, None], 3, axis=1)
    expected, _ = simulate(drawn[0], step * np.arange(angles.size), held, 0.3)
    assert np.abs(angles - expected).max() < 0.02
