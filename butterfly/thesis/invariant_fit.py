"""The thesis's re-calibration (118), beside the energy balance that replaces it.

(118) fits the decay (114) of the invariant I = E - E* (110). It uses neither the recorded input nor
p2 and assumes an exact controller: any other effect of the input biases p4.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid, solve_ivp
from scipy.optimize import least_squares

from butterfly.arrays import Samples
from butterfly.identification.test_functions import HALF_WIDTH, VELOCITY_SHARE, Balance
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.model.energy import Orbit, energy
from butterfly.model.parameters import LumpedParameters
from butterfly.orbit.controller import gain_for
from butterfly.orbit.recalibration import RecalibrationOptions, recalibrate
from butterfly.signals.polynomials import slope
from butterfly.thesis.claims import CLOSE, Claim, ThesisFigure, near

AMPLITUDE = np.pi / 3
"""Of the nominal motion in rad."""

_STEP = 1e-3  # s
_PERIODS, _PARTS = 16, 50  # of the nominal motion, and of each of them: T/h
_START = 0.8  # of the amplitude
_MULTIPLIER = 0.5  # share of I that a period leaves
_FACTORS = np.geomspace(0.1, 10, 21)


class ClosedLoop(NamedTuple):
    """A run of (5) under (103), (109) in continuous time, from beside the orbit."""

    log: Log
    gamma: float  # of the controller, in units of the input per rad/s and J
    period: float  # of its orbit in s

    @classmethod
    def of(
        cls, robot: LumpedParameters, believed: LumpedParameters, noise: float = 0.0
    ) -> ClosedLoop:
        """Simulate a controller's believed robot for the real one; noise of the angle in rad."""
        orbit = Orbit.of_amplitude(believed, AMPLITUDE)
        gamma = gain_for(orbit, _MULTIPLIER)

        def command(angle: Samples, velocity: Samples) -> Samples:
            excess = energy(believed, angle, velocity) - orbit.energy
            return np.asarray(velocity * (believed.p2 / believed.p4 - gamma * excess))

        def rates(_: float, state: Samples) -> list[float]:
            angle, velocity = state
            torque = robot.p4 * command(angle, velocity) - robot.p3 * np.sin(angle)
            return [velocity, (torque - robot.p2 * velocity) / robot.p1]

        time = np.arange(0, _PERIODS * orbit.period, _STEP)
        start, span = [_START * AMPLITUDE, 0.0], (0.0, time[-1])
        angle, velocity = solve_ivp(rates, span, start, "DOP853", time, rtol=1e-10, atol=1e-12).y
        measured = angle + noise * np.random.default_rng(0).standard_normal(time.size)
        kinds = {"input_kind": InputKind.TORQUE, "intersample": Intersample.FIRST_ORDER_HOLD}
        log = Log(time, command(angle, velocity), measured, **kinds)  # type: ignore[arg-type]
        return cls(log=log, gamma=gamma, period=orbit.period)

    def residuals(self, values: LumpedParameters) -> Samples:
        """Return the (n,) differences in J of (118), with exponents along the motion: exact."""
        angle, reach = self.log.angle, round(VELOCITY_SHARE * HALF_WIDTH / _STEP)
        velocity = slope(angle, reach, 4, _STEP)
        area = cumulative_trapezoid(velocity**2, dx=_STEP, initial=0)
        excess = energy(values, angle, velocity) - energy(values, AMPLITUDE, 0.0)
        some = slice(None, None, round(self.period / _PARTS / _STEP))
        decay = np.exp(-values.p4 * self.gamma * np.diff(area[some]))
        return np.asarray(excess[some][1:] - decay * excess[some][:-1])

    def fitted(self, start: LumpedParameters) -> LumpedParameters:
        """Return p3 and p4 fitted by (118); the others are those of ``start``."""

        def scaled(shares: Samples) -> LumpedParameters:
            return replace(start, p3=shares[0] * start.p3, p4=shares[1] * start.p4)

        best = least_squares(
            lambda x: self.residuals(scaled(x)) / start.p3, [1, 1], bounds=(0, np.inf)
        )
        return scaled(best.x)

    def balanced(self, inertia: float) -> LumpedParameters:
        """Return all parameters by the energy balance with the recorded input, given p1."""
        options = RecalibrationOptions(balance=Balance.ENERGY, candidates=())
        return recalibrate([self.log], 0.0, options).loaded(inertia=inertia)


def scale_figure(robot: LumpedParameters) -> ThesisFigure:
    """Return the loss (118) over a factor on p1 and p3, and on p3 alone."""
    loop, curves, losses = ClosedLoop.of(robot, robot, 1e-4), {}, []
    for name, scaled in (("p1 and p3", ("p1", "p3")), ("p3 with p1 held", ("p3",))):
        tried = [replace(robot, **{k: f * getattr(robot, k) for k in scaled}) for f in _FACTORS]
        losses.append(np.array([np.mean(loop.residuals(values) ** 2) for values in tried]))
        curves[name] = "line", {"factor": _FACTORS, f"loss by {name}": losses[-1]}
    free, held = (float(_FACTORS[loss.argmin()]) for loss in losses)
    power = float(np.polyfit(np.log(_FACTORS), np.log(losses[0]), 1)[0])
    claims = [
        near("a factor on p1 and p3 scales the loss with the power", 2, power),
        near("p1 held: it is least at a factor of", 1, held),
        near("p1 and p3 free: at a factor of", 1, free),
    ]
    title, axes = "Loss of (118), 0.1 mrad of noise", ("factor on the true values", "loss in J²")
    about = (
        "(118) minimises squares of I(t) − exp(−p4 γ ∫θ̇² dt) I(t − h), where I = E − E* is linear "
        "in p1 and p3. It does not use the recorded input."
    )
    return ThesisFigure("invariant_scale", title, axes, curves, claims, {}, "xy", about=about)


def cases_figure(robot: LumpedParameters) -> ThesisFigure:
    """Return p4 by (118) and by the energy balance: exact case, noise, wrong controllers."""
    cases = {
        "exact": (robot, 0.0),
        "1 mrad of noise": (robot, 1e-3),
        "3 mrad of noise": (robot, 3e-3),
        "p3 10 % off": (replace(robot, p3=1.1 * robot.p3), 0.0),
        "p4 20 % off": (replace(robot, p4=1.2 * robot.p4), 0.0),
        "p2 left out": (replace(robot, p2=0.0), 0.0),
    }
    loops = [ClosedLoop.of(robot, *case) for case in cases.values()]
    start, names = replace(robot, p3=1.1 * robot.p3, p4=0.8 * robot.p4), np.array([*cases])
    fitted = np.array([loop.fitted(start).p4 for loop in loops]) / robot.p4
    balanced = np.array([loop.balanced(robot.p1).p4 for loop in loops]) / robot.p4
    worst, off = (float(np.abs(shares - 1).max()) for shares in (fitted, balanced))
    others = ", ".join(f"{share:.2g}" for share in fitted[1:])
    claims = [
        near("exact controller, no noise: (118) finds a share of p4 of", 1, float(fitted[0])),
        Claim(f"(118) finds a share of 1 in the other cases (here {others})", worst < CLOSE),
        Claim(f"the energy balance does in all (here within {100 * off:.1g} %)", off < CLOSE),
    ]
    curves = {
        "(118)": ("crosses", {"case": names, "share by (118)": fitted}),
        "energy balance (114)": ("circles", {"case": names, "share by balance": balanced}),
    }
    title, axes = "p4 by (118), and by the energy balance", ("case", "share of the true p4")
    about = (
        f"{_PERIODS} periods, p1 held; noise of the angle, or a controller that goes by wrong "
        "values. The energy balance (114) takes the recorded input from the same log."
    )
    return ThesisFigure("invariant_p4", title, axes, curves, claims, about=about)
