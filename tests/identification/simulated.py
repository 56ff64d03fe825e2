"""Logs of a simulated robot, short and coarse, for the tests of estimators."""

import math
from dataclasses import replace
from itertools import product

import numpy as np

from butterfly.identification.data import DataSet
from butterfly.identification.design import next_experiments, wanted
from butterfly.identification.estimate import Estimate
from butterfly.identification.linearisation import Linearisation
from butterfly.logs.log import InputKind, Intersample, Log, Sine
from butterfly.model.greybox import simulate
from butterfly.model.linear import quasi_linear_response
from butterfly.model.parameters import LumpedParameters
from butterfly.model.prior import NO_PRIOR
from butterfly.signals.frequency_response import ResponsePoint, SineFit
from tests.conftest import MASSES
from tests.independent.integrator import motion

ROBOT = LumpedParameters(p1=0.003, p2=1e-3, p3=0.04, p4=0.5, coulomb=8e-4)
RICH = replace(ROBOT, p2=3e-4, p3=0.03, coulomb=2e-3, delay=0.004, drag=1e-4, load=5e-4)
RICH = replace(RICH, bias=2e-3, p3_offset=-1e-3, stribeck=5e-4)
"""All kinds of friction, a bias and an offset at work."""

TONES = (1.7, 2.9, 4.3, 6.1, 8.3)
SWINGS = {2.0: 0.2, 3.0: 0.6, 4.4: 0.3, 7.5: 0.15, 8.5: 0.5}
SLOW = {1.5: 0.4, 2.2: 0.5, 8.5: 0.3, 9.0: 0.1, 14.0: 0.03, 16.0: 0.012, 20.0: 0.006}
"""Frequencies in rad/s and swings in rad; slow ones for friction that is lost in fast ones."""

STEP = 2.5e-3


def estimate_of(values, covariance, known=NO_PRIOR, names=("p1", "p2", "p3", "p4"), reach=4):
    """Return an estimate of given values, with intervals of some standard errors."""
    errors = np.sqrt(np.diag(covariance))
    limits = {"lower": values - reach * errors, "upper": values + reach * errors}
    told = {"values": np.array(values), "covariance": np.array(covariance), "known": known}
    return Estimate(method="", names=names, **told, **limits)


def simulated(
    robot, mass, signal, duration, *, start=0.0, step=STEP, sine=None, zero=0.0, **properties
):
    """A log by the grey box of a signal that is linear between samples; more as of `Log`."""
    time = np.arange(0, duration, step)
    late = np.column_stack([time[:-1], time[:-1] + step / 2, time[1:]]) - robot.delay
    inputs = signal(np.maximum(late, 0.0))
    inputs = np.sign(inputs) * np.maximum(np.abs(inputs) - robot.dead_zone, 0.0)
    inputs /= 1 + robot.compression * np.abs(inputs)
    angle, _ = simulate(robot.with_added_mass(mass), time, inputs, start)
    properties |= {"input_kind": InputKind.TORQUE, "intersample": Intersample.FIRST_ORDER_HOLD}
    return Log(time, signal(time), zero + angle, added_mass=mass, excitation=sine, **properties)


def next_runs(data, found, *, goal=0.01, **asked):
    """Plans of next runs, to a goal in per cent of the default, as `bf.design` makes them."""
    asked = {"duration": 40.0, "price": 120.0} | asked
    return next_experiments(data, found, wanted(found, data.logs, goal), **asked)


def noisy(logs, noise, rng):
    """Logs with white noise of a standard deviation in rad besides."""
    return [
        replace(log, angle=log.angle + noise * rng.standard_normal(log.time.size)) for log in logs
    ]


def driven(joint, time, inputs, start=0.0, **properties):
    """A log by the independent integrator, in N m; more as of `Log`."""
    angle, _ = motion(joint, time, inputs, start)
    return Log(time, inputs, angle, input_kind=InputKind.TORQUE, **properties)


def wild(robot, masses=MASSES, duration=12.0):
    """Logs of sums of sines, which need not settle; gentle ones where friction is lost in speed."""
    gentle = 0.25 if robot.stribeck else 1.0

    def tones(seed):
        phases = np.random.default_rng(seed).uniform(0, 2 * math.pi, len(TONES))
        pairs, size = list(zip(TONES, phases, strict=True)), 0.02 * gentle
        return lambda t: size * sum(np.sin(w * t + p) - np.sin(p) for w, p in pairs)

    start = 0.5 * gentle
    return [simulated(robot, m, tones(k), duration, start=start) for k, m in enumerate(masses)]


def response(mass, omega, phasor, *, input_=1.0, error=1e-6):
    """A steady response with an angle's phasor in rad, each component of which is uncertain."""
    about = {"omega": omega, "offset": 0.0, "residual_rms": 0.0}
    fit = SineFit(**about, phasors=np.array([phasor]), covariance=np.eye(2) * error**2)
    return ResponsePoint(added_mass=mass, input=input_, angle=fit, drift=0.0, label="")


def steady(robot, swings, masses=MASSES, duration=12.0):
    """Logs of sines that swing steadily from the start, each at the end of a swing."""
    logs = []
    for mass, (omega, swing) in product(masses, swings.items()):
        gain = complex(quasi_linear_response(robot.with_added_mass(mass), omega, swing))
        sine = Sine(omega=omega, amplitude=swing / abs(gain))
        since = (math.pi / 2 - np.angle(gain)) / omega

        def turned(time, sine=sine, since=since):
            return sine.sample(since + time)

        logs.append(simulated(robot, mass, turned, duration, start=swing, step=2 * STEP, sine=sine))
    return logs


def cells(names, rows, residuals, **more):
    """Equations about 0 without bounds, of (k, m, n) rows and (k, m) residuals of k cells.

    Each cell is a log of its own but where more is said.
    """
    count, size, width = rows.shape
    told = {"values": np.zeros(width), "lower": np.full(width, -np.inf), "log": np.arange(count)}
    told |= {"ends": size * np.arange(1, count + 1), "residuals": residuals.ravel()}
    return Linearisation(names=names, rows=rows.reshape(-1, width), **told | more)


def equations_about(values, residuals, slopes):
    """Equations of one log, without bounds."""
    rows, residuals = np.asarray(slopes, dtype=float), np.asarray(residuals, dtype=float)
    names = tuple(f"b{k}" for k in range(len(values)))
    told = {"names": names, "values": values, "lower": np.full(len(values), -np.inf)}
    ends = {"ends": np.array([residuals.size]), "log": np.array([0])}
    return Linearisation(rows=rows, residuals=residuals, **told, **ends)


def robot_with_drag():
    """Return the data set of few noisy sines of a robot with drag, its logs numbered."""
    few = {omega: SWINGS[omega] for omega in (2.0, 3.0, 4.4, 8.5)}
    logs = noisy(steady(replace(ROBOT, drag=8e-4), few), 1e-3, np.random.default_rng(0))
    return DataSet.of([replace(log, name=f"{k}") for k, log in enumerate(logs)])
