"""Trials of a fit that are far stiffer than any joint of such logs cost no more than others."""

from dataclasses import replace

import numpy as np
import pytest

import butterfly as bf
from butterfly.identification.fit import MOST, Box, minimise
from butterfly.identification.segments import FINEST, Segments
from butterfly.logs.log import Log
from butterfly.model.greybox import Columns, simulate, steps_of_interval
from butterfly.model.kernel.equation import MOST_STEPS
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.progress import budget
from tests.identification.simulated import cells

JOINT = LumpedParameters(p1=0.004, p2=0.002, p3=0.05, p4=0.3, coulomb=0.001)
STEP = 0.01
TIME = np.arange(0, 8, STEP)
MASS = AddedMass(mass=0.1, arm=0.1)
NAMES = ("p1", "p2", "p3", "p4", "coulomb")


def recorded(joint=JOINT, mass=NO_ADDED_MASS, slip=0.0, since=4.0, seed=0):
    """Return a log of steps of the input at random instants; the encoder slips in it."""
    random = np.random.default_rng(seed)
    held = 0.15 * np.repeat(random.choice([-1.0, 1.0], TIME.size // 40), 40)
    inputs = np.repeat(held[:-1, None], 3, axis=1)
    angle, _ = simulate(joint.with_added_mass(mass), TIME, inputs, 0.0)
    angle = angle + 1e-4 * random.standard_normal(TIME.size) + slip * (since <= TIME)
    return Log(time=TIME, input=held, angle=angle, input_kind="torque", added_mass=mass)


STIFF = {
    "speed": {"p2": 400.0},
    "drag": {"drag": 100.0},
    "lag": {"back_emf": 1e-3, "time_constant": 8e-5},
    "bristles": {"bristle_stiffness": 50.0},
    "base": {"base_compliance": 1e-7, "base_frequency": 2e4},
    "base beside a light joint": {"p1": 1e-4, "base_compliance": 6.153e-3},
}


@pytest.mark.parametrize("names", [NAMES, ()])
@pytest.mark.parametrize("stiff", STIFF)
def test_a_trial_far_stiffer_than_the_first_guess_diverges_and_takes_few_steps(stiff, names):
    joint = replace(JOINT, **STIFF[stiff])
    assert FINEST < steps_of_interval(joint, 1.0, STEP) <= MOST_STEPS
    segments = Segments(recorded(), JOINT)
    trial = Columns.of(names, joint)
    with np.errstate(all="ignore"):
        errors, _ = segments.linearised(trial, 0.0, np.array([[0.0, 1.0]]))
    assert not np.isfinite(errors).all()
    assert segments.spend() <= FINEST * TIME.size


@pytest.mark.parametrize(
    ("lasting", "steps"),
    [
        ({"p2": 0.8}, 4),  # the speed settles in 5 ms
        ({"back_emf": 1e-3, "time_constant": 4e-4}, 400),
        ({"bristle_stiffness": 5.0}, 300),
        ({"base_compliance": 5e-4, "base_frequency": 300.0, "base_damping": 0.1}, 10),
    ],
)
def test_a_sound_joint_however_stiff_is_simulated_as_without_a_bound(lasting, steps):
    joint = replace(JOINT, **lasting)
    log, near = recorded(joint), replace(joint, p1=1.3 * joint.p1, p2=0.7 * joint.p2)
    segments, begin = Segments(log, near), np.zeros((1, 2))
    errors, _ = segments.linearised(Columns.of((), joint), 0.0, begin)
    taken = segments.spend()
    ((grid, angle, _),) = segments.run(joint, 0.0, begin)
    free = np.interp(log.time, grid, angle)
    assert np.abs(free - log.angle).max() < 1e-3
    assert np.std(errors) < 2e-4
    assert taken == segments.spend()
    assert taken / grid.size > steps / 4


@pytest.mark.parametrize(("growth", "ends"), [(1, False), (10, True)])
def test_a_descent_into_ever_stiffer_joints_ends_with_the_steps_that_it_is_given(growth, ends):
    """It descends a curved valley, where an expansion takes many times the steps of the first."""
    taken = []

    def expand(values, _):
        x, y = values
        rows = np.array([[-20 * x, 10.0], [-1.0, 0.0]])
        taken.append(100 * (growth if taken else 1))
        errors = np.array([10 * (y - x**2), 1 - x])
        return replace(cells(("x", "y"), rows[None], errors[None], values=values), steps=taken[-1])

    box = Box(np.full(2, -np.inf))
    given = MOST * 100
    end = minimise(expand, expand(np.array([-1.2, 1.0]), np.inf), box, steps=given)
    assert (sum(taken[1:]) >= given) == ends
    assert end.converged != ends
    assert sum(taken[1:]) < given + taken[-1] + 1
    assert ends or end.values == pytest.approx([1.0, 1.0])


def test_the_steps_of_a_simulation_are_counted_each_log_for_itself_with_any_number_of_threads():
    logs = [recorded(seed=1), recorded(mass=MASS, seed=2)]
    counts = []
    for workers in (1, 3):
        with budget(1e9) as search:
            bf.identify(logs, "output-error", workers=workers, terms=())
        counts.append(search.steps)
    assert counts[0] == counts[1] > sum(log.time.size for log in logs)
