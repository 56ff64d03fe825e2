"""The equations of output error: their derivatives, and parts of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.identification.estimators import OutputError
from butterfly.logs.log import Intersample, Sine
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import offered
from tests.conftest import MASSES
from tests.identification.simulated import simulated

ROBOT = LumpedParameters(
    p1=0.003,
    p2=3e-4,
    p3=0.03,
    p4=0.5,
    coulomb=2e-3,
    delay=0.0042,
    drag=1e-4,
    load=5e-4,
    bias=2e-3,
    p3_offset=-1e-3,
    stribeck=5e-4,
    stribeck_velocity=0.13,
    tilt=0.2,
    cogging=2e-4,
    cogging_cosine=-1e-4,
    cogging_periods=3.0,
)
ALL = offered("output-error")


def _log(mass, omega, amplitude, hold):
    sine = Sine(omega=omega, amplitude=amplitude)
    log = simulated(ROBOT, mass, sine.sample, 12.0, start=0.05, sine=sine)
    source = f"{mass.mass:g}-{omega:g}"
    return replace(log, angle=log.angle + 0.6, intersample=hold, source=source)


@pytest.fixture(scope="module", params=list(Intersample))
def problem(request):
    logs = [
        _log(mass, *drive, request.param) for mass in MASSES[:2] for drive in ((4, 0.02), (6, 0.05))
    ]
    data = DataSet.of(logs)
    estimator = OutputError(
        terms=ALL, per_mass=("zero",), per_log=("velocity",), window=8.0, cogging_periods=3.0
    )
    found = estimator.problem(data.logs, ROBOT, data.equilibria)
    moving = [
        0.1 * (name == "velocity") for name, _ in found.keys
    ]  # at rest it has two derivatives
    return replace(found, initial=found.initial + moving)


def _residuals(problem, scaled):
    return np.concatenate([log.residuals for log in problem.equations(scaled).logs])


def _jacobian(problem):
    """At the beginning, all logs' one below another."""
    return np.concatenate([log.jacobian for log in problem.equations(problem.initial).logs])


def _central(problem, k, step):
    moved = np.zeros(len(problem.keys))
    moved[k] = step
    there, back = (_residuals(problem, problem.initial + sign * moved) for sign in (1, -1))
    return (there - back) / (2 * step)


def test_every_column_is_the_central_difference(problem):
    jacobian = _jacobian(problem)
    for k, (name, whose) in enumerate(problem.keys):
        column = jacobian[:, k]
        differences = [_central(problem, k, step) for step in (1e-4, 1e-5, 1e-6)]
        error = min(np.linalg.norm(column - each) for each in differences)
        # The drive has kinks where a stamp passes an edge, by which the delay is felt.
        tolerance = 1e-3 if name == "delay" else 1e-5
        assert error < tolerance * np.linalg.norm(column), (name, whose)


def test_what_belongs_to_one_log_or_mass_moves_no_other(problem):
    logs = problem.equations(problem.initial).logs
    for k, (_, whose) in enumerate(problem.keys):
        for simulation, log in zip(problem.simulations, logs, strict=True):
            concerned = whose in {None, simulation.log.added_mass, simulation.log.name}
            assert concerned or not np.any(log.jacobian[:, k])


def test_compressed_equations_say_the_same(problem):
    equations = problem.equations(problem.initial)
    for log in equations.logs:
        weights = np.linspace(0.5, 2.0, log.residuals.size)
        rows, residuals = log.weighted(weights).compressed()
        jacobian = log.jacobian
        normal = jacobian.T @ (weights[:, None] * jacobian)
        np.testing.assert_allclose(rows.T @ rows, normal, atol=1e-10 * np.abs(normal).max())
        pull = jacobian.T @ (weights * log.residuals)
        np.testing.assert_allclose(rows.T @ residuals, pull, atol=1e-10 * np.abs(pull).max())


def test_a_part_has_the_equations_of_its_logs(problem):
    whole = problem.equations(problem.initial)
    part, kept = problem.part([2, 3])
    own, taken = part.equations(part.initial), whole.part([2, 3], kept)
    assert own.cost == taken.cost
    np.testing.assert_array_equal(own.gradient, taken.gradient)
    np.testing.assert_array_equal(own.curvature, taken.curvature)
    names = {name for name, whose in part.keys if whose is not None}
    assert names == {"zero", "velocity"}
    assert len(part.keys) == len(problem.keys) - 3  # one zero and two velocities less


def test_equations_foretell_residuals_nearby(problem):
    step = 1e-5 * np.linspace(-1, 1, len(problem.keys))
    foretold = problem.equations(problem.initial).moved(step)
    found = problem.equations(problem.initial + step)
    for one, other in zip(foretold.logs, found.logs, strict=True):
        np.testing.assert_allclose(one.residuals, other.residuals, atol=1e-8)


def test_a_friction_at_its_bound_can_leave_it():
    """The derivative at 0 is that towards friction, not 0."""
    data = DataSet.of([_log(mass, 4, 0.02, Intersample.FIRST_ORDER_HOLD) for mass in MASSES[:2]])
    frictionless = replace(ROBOT, coulomb=0.0, stribeck=0.0, load=0.0)
    estimator = OutputError(terms=("stribeck", "load"), window=8.0)
    problem = estimator.problem(data.logs, frictionless, data.equilibria)
    jacobian = _jacobian(problem)
    for name in ("coulomb", "stribeck", "load"):
        k = problem.keys.index((name, None))
        moved = problem.initial.copy()
        moved[k] += 1e-6
        difference = (_residuals(problem, moved) - _residuals(problem, problem.initial)) / 1e-6
        np.testing.assert_allclose(
            jacobian[:, k], difference, atol=1e-3 * np.abs(difference).max(), err_msg=name
        )
