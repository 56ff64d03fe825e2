"""The weak form against one bare compiled integration of the same logs; CPU time, in turn."""

import numpy as np

from butterfly.identification.estimators import WeakForm
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.greybox import simulate
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.signals.excitations import Multisine
from tests.benchmarks.bars import measured
from tests.benchmarks.cpu_time import least_seconds

ROBOT = LumpedParameters(p1=0.00325, p2=1e-3, p3=0.04905, p4=10.0, coulomb=1e-4)
MASSES = (AddedMass(), AddedMass(mass=0.05, arm=0.1))
MULTISINE = Multisine(base=0.5, harmonics=(3, 4, 5, 7, 9, 11, 13, 16), peak=5e-4, seed=0)
TIME = 1e-3 * np.arange(70_001)
RESOLUTION = 2 * np.pi / 8192


def _integrated(mass):
    held = np.repeat(MULTISINE.sample(TIME[:-1])[:, None], 3, axis=1)
    return simulate(ROBOT.with_added_mass(mass), TIME, held, 0.0)[0]


def _log(mass, rng):
    noisy = _integrated(mass) + 2e-4 * rng.standard_normal(TIME.size)
    return Log(
        time=TIME,
        input=MULTISINE.sample(TIME),
        angle=RESOLUTION * np.round(noisy / RESOLUTION),
        input_kind=InputKind.TORQUE,
        intersample=Intersample.ZERO_ORDER_HOLD,
        added_mass=mass,
    )


def test_the_weak_form_of_a_large_sweep_s_logs_costs_a_few_integrations_of_them():
    """One of these is its own: the motion that frees it of the noise's bias is simulated."""
    rng = np.random.default_rng(0)
    logs = [_log(mass, rng) for mass in MASSES]
    held = np.repeat(logs[0].input[:-1, None], 3, axis=1)
    zeros = dict.fromkeys(MASSES, 0.0)

    def integrate():
        for mass in MASSES:
            simulate(ROBOT.with_added_mass(mass), TIME, held, 0.0)

    def fit():
        return WeakForm(terms=()).of_logs(logs, zeros)

    bare, whole = least_seconds(integrate, fit)
    measured("weak form of two logs of 70 s", whole / bare)
