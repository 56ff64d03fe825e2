"""The torque that all identified terms leave over, and the missing term that it looks like."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.residuals import (
    ResidualEquations,
    ResidualSummary,
    SensorErrors,
    absent_terms,
    rms,
    slow_velocity,
    summarise_residuals,
)
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FreeRun, Setting
from butterfly.identification.test_functions import Averaging, WeakSignals
from butterfly.logs.log import Log
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.terms import TERMS, FrictionTerms

Samples = NDArray[np.float64]

HALF_WIDTHS = (0.05, 0.25)
"""Least and largest half-width in s of the bumps over which the torque is averaged."""

LEAST_SIZE = 5e-3
"""Share of the motor's torque below which nothing is said: averages are no more exact than that."""

_OF_A_PERIOD = 1 / 8  # of the drive or of the resonance, a bump's half-width
_ACTING = tuple(row.name for row in TERMS.values() if row.basis or row.derivative)
_AVERAGED = (*_ACTING, "delay")


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualTorque:
    """What the model leaves over of the torque in one log, averaged over short bumps."""

    label: str  # of the log
    # (n,) instants in s at which the joint moves, angle in rad from the hanging position, velocity
    # in rad/s, N m
    time: Samples
    angle: Samples
    velocity: Samples
    torque: Samples
    left_over: ResidualSummary  # what it looks like


def residual_torques(
    data: DataSet, estimate: Estimate, numbers: Sequence[int] | None = None
) -> tuple[ResidualTorque, ...]:
    """Subtract all terms of an estimate from the torque, and name what is left by one it lacks.

    Averaged over a bump phi, the acceleration becomes int phi'' th, so nothing is differentiated
    twice; where the joint may stick, friction is no function of the motion and nothing is said.
    InputError if a log, of these numbers or of all, is shorter than a bump.
    """
    predictor = data.simulations
    chosen = range(len(data.logs)) if numbers is None else numbers
    model = _Model(
        names=tuple(name for name in (*_AVERAGED, "tilt") if name in estimate.names),
        owners=estimate.owners(data.unread),
        missing=absent_terms(estimate, data.logs[0].added_mass),
    )
    slow = slow_velocity(data.logs[k] for k in chosen)
    averaged = [_averaged(data.logs[k], predictor.setting(k, estimate), slow) for k in chosen]
    balances = [
        model.balance(each, _sensor_torque(each, predictor.run_with(k, each.setting)))
        for k, each in zip(chosen, averaged, strict=True)
    ]
    _, left = summarise_residuals(balances, LEAST_SIZE)
    return tuple(
        ResidualTorque(
            label=each.log.label,
            time=each.signals.time[each.moving],
            angle=each.signals.angle[each.moving],
            velocity=each.signals.velocity[each.moving],
            torque=balance.left,
            left_over=own,
        )
        for each, balance, own in zip(averaged, balances, left, strict=True)
    )


class _Averaged(NamedTuple):
    """One log's torques, averaged over bumps of a half-width in s."""

    log: Log
    setting: Setting
    loaded: LumpedParameters
    signals: WeakSignals
    half_width: float

    @property
    def moving(self) -> NDArray[np.bool_]:
        return self.signals.moving

    def mean(self, name: str) -> Samples:
        """(n,) averages where the joint moves of what a parameter multiplies."""
        return self.signals.mean[name][self.moving]


class _Model(NamedTuple):
    """Which terms a model has, whose its zeros and biases are, and which terms it lacks."""

    names: tuple[str, ...]
    owners: list[tuple[str, AddedMass | str | None]]
    missing: tuple[str, ...]

    def balance(self, each: _Averaged, noise: float) -> ResidualEquations:
        """Return what one log says, ``noise`` being the torque in N m of its sensor's errors."""
        inertia = each.loaded.p1 * each.mean("p1")
        motor = rms(each.loaded.p4 * each.mean("p4")) or rms(inertia)
        columns = [self._column(name, each) for name in self.names]
        columns += [self._owned(name, whose, each) for name, whose in self.owners]
        return ResidualEquations(
            left=_unbalanced(each),
            known=np.column_stack(columns),
            candidates={name: each.mean(name) for name in self.missing},
            whole=motor or 1.0,
            noise=noise,
        )

    @staticmethod
    def _column(name: str, each: _Averaged) -> Samples:
        """(n,) what a parameter changes; the tilt takes its part of the added mass's moment."""
        if name == "tilt":
            return each.log.added_mass.gravity_moment * each.mean("p3")
        return each.mean(name)

    @staticmethod
    def _owned(name: str, whose: AddedMass | str | None, each: _Averaged) -> Samples:
        """(n,) what a zero, which turns gravity, or a bias changes; 0 in another's log."""
        mine = whose in {None, each.log.added_mass, each.log.name}
        column = each.mean("bias") if name == "bias" else each.loaded.p3 * each.mean("p3_offset")
        return column * mine


def _averaged(log: Log, setting: Setting, slow: float) -> _Averaged:
    """Average the torques of a log; Stribeck friction below ``slow`` if the model has none."""
    parameters = setting.parameters
    loaded = parameters.with_added_mass(log.added_mass)
    half_width = _half_width(log, loaded)
    sought = parameters if parameters.stribeck else replace(parameters, stribeck_velocity=slow)
    signals = Averaging(log, setting.zero, half_width, sought).signals(
        _AVERAGED, delay=parameters.delay, drive=parameters.drive
    )
    return _Averaged(log, setting, loaded, signals, half_width)


def _half_width(log: Log, loaded: LumpedParameters) -> float:
    """Return that in s of the bumps: short beside a period, as long as that allows."""
    omega = log.excitation.omega if log.excitation else resonance_frequency(loaded)
    period = 2 * math.pi / omega if omega else math.inf
    return min(max(_OF_A_PERIOD * period, HALF_WIDTHS[0]), HALF_WIDTHS[1])


def _unbalanced(each: _Averaged) -> Samples:
    """(n,) sum of all torques in N m: tau_eps = p1 thdd + p2 thd + p3 sin th + ... - p4 v (5).

    The load on the bearing enters by its own basis, so that T_c is the bare hand's.
    """
    values = each.setting.parameters
    own = {"p1": each.loaded.p1, "p3": each.loaded.p3}
    rows = (name for name in _ACTING if not TERMS[name].of_gain)
    return np.asarray(sum(own.get(name, getattr(values, name)) * each.mean(name) for name in rows))


def _sensor_torque(each: _Averaged, run: FreeRun) -> float:
    """Return the rms torque in N m of the sensor's errors, nearly all of it by the inertia."""
    log = each.log
    angle = run.simulated if np.isfinite(run.simulated).all() else log.angle
    errors = SensorErrors.of(log.angle, angle).draw(angle, np.random.default_rng(0), unsure=0.0)
    noisy = Averaging(replace(log, angle=errors), 0.0, each.half_width, FrictionTerms())
    return each.loaded.p1 * float(np.std(noisy.signals(["p1"]).mean["p1"]))
