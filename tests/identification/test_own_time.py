"""Joints that nothing holds, moved by somebody's loop, by an integrator of their own."""

import math

import numpy as np
import pytest

from butterfly.identification.data import DataSet
from butterfly.identification.estimators import OutputError
from butterfly.identification.identify import identify
from butterfly.logs.log import InputKind, Log
from butterfly.model.prior import Prior
from tests.independent.drives import clock
from tests.independent.integrator import Joint, Law, tracking

COUNT = 2 * np.pi / 2**14
TRUE = {"p1": 0.02, "p2": 0.004, "coulomb": 0.3, "delay": 4e-3}
JOINT = Joint(
    inertia=TRUE["p1"],
    viscous=TRUE["p2"],
    gravity=0.0,
    gain=1.0,
    coulomb=TRUE["coulomb"],
    delay=TRUE["delay"],
)
KNOWN = Prior.of({"p4": 1.0, "p3": 0.0})


def _log(seed, duration, joint=JOINT):
    """Return the log of a joint that a saturated PD law takes from angle to angle."""
    rng = np.random.default_rng(seed)
    stamps = clock(rng, duration, 5e-3, 0.05)
    law = Law(stiffness=4.0, damping=0.4, limit=1.0, count=COUNT, share=0.5)
    levels = rng.uniform(-1.0, 1.0, math.ceil(duration / 2.0) + 1)
    plan = levels[(stamps / 2.0).astype(int)], 0 * stamps, 0 * stamps
    noise = 2e-4 * rng.standard_normal(stamps.size)
    _, _, inputs, readings = tracking(joint, law, (stamps, *plan, noise))
    return Log(stamps, inputs, readings, input_kind=InputKind.TORQUE, name=f"log {seed}")


def _limits(estimate):
    rows = zip(estimate.names, estimate.lower.tolist(), estimate.upper.tolist(), strict=True)
    return {name: (lower, upper) for name, lower, upper in rows}


@pytest.fixture(scope="module")
def arm():
    """Two logs of a minute."""
    return DataSet.of([_log(1, 60.0), _log(2, 60.0)], known=KNOWN)


def test_a_joint_that_nothing_holds_is_fitted_over_its_own_time(arm):
    found = identify(arm)
    limits = _limits(found.estimate)
    for name, true in TRUE.items():
        slack = 2e-3 * true  # where friction holds the joint within a step of the simulation
        assert limits[name][0] - slack <= true <= limits[name][1] + slack, name
    assert found.estimate.relative_half_widths["p1"] < 0.02
    assert found.residuals.times < 1.5


def test_whole_logs_are_simulated_for_who_asks_for_them(arm):
    assert OutputError(terms=(), horizon=0.0)(arm).horizon == math.inf
    assert OutputError(terms=(), horizon=math.inf)(arm).horizon == math.inf
    assert OutputError(terms=(), horizon=1.5)(arm).horizon == 1.5


def test_gravity_holds_a_joint_so_that_whole_logs_are_followed():
    held = JOINT._replace(gravity=0.5)
    data = DataSet.of([_log(3, 20.0, held)], known=Prior.of({"p4": 1.0}))
    assert OutputError()(data).horizon is None


def test_where_whole_logs_leave_but_noise_they_stay():
    """No friction to lose its way over, for a few seconds."""
    free = JOINT._replace(coulomb=0.0, delay=0.0)
    data = DataSet.of([_log(4, 6.0, free), _log(5, 6.0, free)], known=KNOWN)
    found = OutputError()(data)
    assert found.horizon is None
    assert found.named["p1"] == pytest.approx(TRUE["p1"], rel=5e-3)
