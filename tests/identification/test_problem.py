"""Equations of logs about values: derivatives, what moves which, and cells."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.identification.estimators import Loss, OutputError
from butterfly.identification.problem import Start
from butterfly.logs.clock import Regime
from butterfly.logs.log import Intersample, Sine
from butterfly.model.terms import BASE_TERMS, GEAR, LOOP_TERMS, offered
from tests.conftest import MASSES
from tests.identification.simulated import RICH, simulated

EVERY = replace(RICH, delay=0.0042, tilt=0.2, stribeck_velocity=0.13)
EVERY = replace(EVERY, cogging=2e-4, cogging_cosine=-1e-4, cogging_periods=3.0)
OTHERS = {*LOOP_TERMS, *BASE_TERMS}  # what no joint has besides all the rest


def _log(mass, omega, amplitude, hold):
    sine = Sine(omega=omega, amplitude=amplitude)
    name = f"{mass.mass:g}-{omega:g}"
    log = simulated(EVERY, mass, sine.sample, 9.0, start=0.05, sine=sine, zero=0.6, source=name)
    switches = Regime(0.0, 0.002), Regime(5.0, 0.001)
    return replace(log, intersample=hold, regimes=switches)


@pytest.fixture(scope="module", params=list(Intersample))
def problem(request):
    drives = ((4, 0.02), (6, 0.05))
    data = DataSet.of(
        [_log(mass, *drive, request.param) for mass in MASSES[:2] for drive in drives]
    )
    local = {"per_mass": ("zero",), "per_log": ("velocity",)}
    terms = tuple(name for name in offered("output-error") if name not in OTHERS)
    estimator = OutputError(terms=terms, **local, window=8.0, cogging_periods=3.0)
    found = estimator.problem(data.logs, Start(EVERY, data.equilibria))
    # At rest, without a dead zone or friction of a gear, it has two slopes.
    away = {"velocity": 0.02, "dead_zone": 5e-4} | dict.fromkeys(GEAR, 0.01)
    moving = [away.get(name, 0.0) for name, _ in found.keys]
    return replace(found, initial=found.initial + moving)


@pytest.fixture(scope="module")
def equations(problem):
    return problem.equations(problem.initial)


def _residuals(problem, moved):
    """Return all logs' residuals beside the beginning."""
    return problem.equations(problem.initial + moved).residuals


def test_every_column_is_the_central_difference(problem, equations):
    columns = equations.rows.T
    units = np.diag(1 / np.linalg.norm(columns, axis=1))  # each moves the residuals by 1
    for (name, whose), unit, column in zip(problem.keys, units, columns, strict=True):
        differences = (
            (_residuals(problem, step * unit) - _residuals(problem, -step * unit))
            / (2 * step * unit.max())
            for step in (1e-5, 1e-6, 1e-4, 1e-7, 1e-8)
        )
        errors = (np.linalg.norm(column - each) for each in differences)
        # The drive has kinks where a stamp passes an edge, by which the delay is felt.
        tolerance = {"delay": 1e-3, "slow_delay": 2e-3}.get(name, 1e-5)
        most = tolerance * np.linalg.norm(column)
        assert any(error < most for error in errors), (name, whose)


def test_what_belongs_to_one_log_or_mass_moves_no_other(problem, equations):
    for k, (_, whose) in enumerate(problem.keys):
        logs = np.split(equations.rows[:, k], equations.ends[:-1])
        for simulation, column in zip(problem.simulations, logs, strict=True):
            concerned = whose in {None, simulation.log.added_mass, simulation.log.name}
            assert concerned or not column.any()


def test_cells_say_the_same_with_the_weights_of_a_loss(equations):
    at = equations.counting(Loss.HUBER)
    roots = np.sqrt(at.loss.weights(at.residuals, at.scale))
    rows, residuals = at.rows * roots[:, None], at.residuals * roots
    for cells in (at.cells(1), at.cells(4)):
        normal, pull = rows.T @ rows, rows.T @ residuals
        np.testing.assert_allclose(cells.curvature, normal, atol=1e-10 * np.abs(normal).max())
        np.testing.assert_allclose(cells.gradient, pull, atol=1e-10 * np.abs(pull).max())
        assert cells.squares.sum() == pytest.approx(residuals @ residuals)


def test_equations_predict_residuals_nearby(problem, equations):
    sizes = 1 / np.linalg.norm(equations.rows, axis=0)
    step = 1e-6 * sizes * np.linspace(-1, 1, len(problem.keys))
    np.testing.assert_allclose(
        equations.moved(step).residuals, _residuals(problem, step), atol=1e-8
    )


def test_a_friction_at_its_bound_can_leave_it():
    """The derivative at 0 is that towards friction, not 0."""
    data = DataSet.of([_log(mass, 4, 0.02, Intersample.FIRST_ORDER_HOLD) for mass in MASSES[:2]])
    frictionless = replace(EVERY, coulomb=0.0, stribeck=0.0, load=0.0)
    estimator = OutputError(terms=("stribeck", "load"), window=4.0)
    problem = estimator.problem(data.logs, Start(frictionless, data.equilibria))
    jacobian = problem.equations(problem.initial).rows
    for name in ("coulomb", "stribeck", "load"):
        k = problem.keys.index((name, None))
        size = 1e-6 / np.linalg.norm(jacobian[:, k])
        step = size * np.eye(len(problem.keys))[k]
        change = (_residuals(problem, step) - _residuals(problem, 0 * step)) / size
        np.testing.assert_allclose(
            jacobian[:, k], change, atol=1e-3 * np.abs(change).max(), err_msg=name
        )


def test_residuals_without_derivatives_are_the_same_for_each_log_s_own_values(problem, equations):
    alike = np.tile(problem.initial, (len(problem.motion), 1))
    bare = problem.equations(alike, slopes=False)
    np.testing.assert_allclose(bare.residuals, equations.residuals, rtol=0, atol=1e-12)
    assert not bare.rows.any()
