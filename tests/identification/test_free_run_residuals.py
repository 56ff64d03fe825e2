"""The equations of output error: their derivatives, and parts of them."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.identification.equations import compressed
from butterfly.identification.estimators import OutputError
from butterfly.identification.estimators.multistart import Start
from butterfly.logs.log import Intersample, Sine
from butterfly.logs.regimes import Regime
from butterfly.model.terms import BASE_TERMS, GEAR, LOOP_TERMS, offered
from tests.conftest import MASSES
from tests.identification.simulated import RICH, simulated

ROBOT = replace(
    RICH,
    delay=0.0042,
    tilt=0.2,
    stribeck_velocity=0.13,
    cogging=2e-4,
    cogging_cosine=-1e-4,
    cogging_periods=3.0,
)

OTHERS = {*LOOP_TERMS, *BASE_TERMS}  # what no joint has besides all the rest


def _log(mass, omega, amplitude, hold):
    sine = Sine(omega=omega, amplitude=amplitude)
    name = f"{mass.mass:g}-{omega:g}"
    log = simulated(ROBOT, mass, sine.sample, 12.0, start=0.05, sine=sine, zero=0.6, source=name)
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
    found = estimator.problem(data.logs, Start(ROBOT, data.equilibria))
    # At rest, without a dead zone or friction of a gear, it has two slopes.
    away = dict.fromkeys(("velocity", "dead_zone", *GEAR), 0.1)
    moving = [away.get(name, 0.0) for name, _ in found.keys]
    return replace(found, initial=found.initial + moving)


@pytest.fixture(scope="module")
def equations(problem):
    return problem.equations(problem.initial)


def _residuals(problem, moved):
    """Return all logs' residuals beside the beginning."""
    logs = problem.equations(problem.initial + moved).logs
    return np.concatenate([log.residuals for log in logs])


def _jacobian(equations):
    return np.concatenate([log.jacobian for log in equations.logs])


def test_every_column_is_the_central_difference(problem, equations):
    units, columns = np.eye(len(problem.keys)), _jacobian(equations).T
    for (name, whose), unit, column in zip(problem.keys, units, columns, strict=True):
        differences = (
            (_residuals(problem, step * unit) - _residuals(problem, -step * unit)) / (2 * step)
            for step in (1e-5, 1e-6, 1e-4)
        )
        errors = (np.linalg.norm(column - each) for each in differences)
        # The drive has kinks where a stamp passes an edge, by which the delay is felt.
        tolerance = {"delay": 1e-3, "slow_delay": 2e-3}.get(name, 1e-5)
        most = tolerance * np.linalg.norm(column)
        assert any(error < most for error in errors), (name, whose)


def test_what_belongs_to_one_log_or_mass_moves_no_other(problem, equations):
    for k, (_, whose) in enumerate(problem.keys):
        for simulation, log in zip(problem.simulations, equations.logs, strict=True):
            concerned = whose in {None, simulation.log.added_mass, simulation.log.name}
            assert concerned or not np.any(log.jacobian[:, k])


def test_compressed_equations_say_the_same(equations):
    for log in equations.logs:
        weights = np.linspace(0.5, 2.0, log.residuals.size)
        weighted = log.weighted(weights)
        (factor,), (residuals,) = compressed([(weighted.rows, weighted.residuals)])
        rows = factor @ weighted.mixture
        jacobian = log.jacobian
        normal = jacobian.T @ (weights[:, None] * jacobian)
        np.testing.assert_allclose(rows.T @ rows, normal, atol=1e-10 * np.abs(normal).max())
        pull = jacobian.T @ (weights * log.residuals)
        np.testing.assert_allclose(rows.T @ residuals, pull, atol=1e-10 * np.abs(pull).max())


def test_equations_predict_residuals_nearby(problem, equations):
    step = 1e-5 * np.linspace(-1, 1, len(problem.keys))
    predicted = np.concatenate([log.residuals for log in equations.moved(step).logs])
    np.testing.assert_allclose(predicted, _residuals(problem, step), atol=1e-8)


def test_a_friction_at_its_bound_can_leave_it():
    """The derivative at 0 is that towards friction, not 0."""
    data = DataSet.of([_log(mass, 4, 0.02, Intersample.FIRST_ORDER_HOLD) for mass in MASSES[:2]])
    frictionless = replace(ROBOT, coulomb=0.0, stribeck=0.0, load=0.0)
    estimator = OutputError(terms=("stribeck", "load"), window=8.0)
    problem = estimator.problem(data.logs, Start(frictionless, data.equilibria))
    jacobian = _jacobian(problem.equations(problem.initial))
    for name in ("coulomb", "stribeck", "load"):
        k = problem.keys.index((name, None))
        step = 1e-6 * np.eye(len(problem.keys))[k]
        change = (_residuals(problem, step) - _residuals(problem, 0 * step)) / 1e-6
        np.testing.assert_allclose(
            jacobian[:, k], change, atol=1e-3 * np.abs(change).max(), err_msg=name
        )


def test_residuals_without_derivatives_are_the_same_for_each_log_s_own_values(problem, equations):
    alike = np.tile(problem.initial, (len(problem.motion), 1))
    bare = problem.equations(alike, slopes=False).logs
    for own, whole in zip(bare, equations.logs, strict=True):
        np.testing.assert_allclose(own.residuals, whole.residuals, rtol=0, atol=1e-12)
        assert not own.jacobian.any()
