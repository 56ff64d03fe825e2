"""The thesis's figures 3 to 12, its formulas (82) to (100), and its re-calibration (118)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid, solve_ivp
from scipy.optimize import least_squares

from butterfly.arrays import Samples
from butterfly.files import shipped
from butterfly.identification.test_functions import HALF_WIDTH, VELOCITY_SHARE, Balance
from butterfly.logs.log import InputKind, Intersample, Log, Sine
from butterfly.logs.manifest import read_manifest
from butterfly.logs.reading import read_entry
from butterfly.model.energy import Orbit, energy
from butterfly.model.linear import LinearJoint, resonance_frequency
from butterfly.model.parameters import NO_ADDED_MASS, LumpedParameters
from butterfly.orbit.controller import gain_for
from butterfly.orbit.recalibration import RecalibrationOptions, recalibrate
from butterfly.signals.frequency_response import (
    periodogram,
    resample,
    rms_amplitude,
    steady_window,
    uniform_grid,
)
from butterfly.signals.hold import slope
from butterfly.thesis import method, tables
from butterfly.thesis.method import between
from butterfly.thesis.tables import (
    CLOSE,
    Claim,
    Row,
    Synthetic,
    ThesisFigure,
    digits,
    near,
    synthetic_log,
)

_WINDOW, _REAL_WINDOW = 40.0, 30.0  # s of Figures 6 and 11
_STEP = 0.04  # s, to which the responses are resampled
_SHOWN = (0.154, 14.0)  # kg and rad/s of Figures 9 to 11
_SWING = 10.0  # degrees, to which the synthetic robot is to keep
_PEAK = (3.5, 4.0)  # rad/s, between which Figure 7 is to peak
_SLIGHTLY = 1.5  # ms, until which an interval is slightly above 1 ms
_SPACINGS = np.geomspace(0.01, 0.5, 9)  # rad/s between gains
_PLACES = np.arange(-6, 7) + (np.arange(20)[:, None] + 0.5) / 20  # of them beside the peak
_ERRORS = np.geomspace(3e-4, 0.3, 7)  # rad/s, of resonances
_REPEATS, _DRAWS = 20, 10  # resonances of each mass, and how often they are drawn
_TABLE_3 = {  # printed frequencies in rad/s, and amplitudes in thousandths, by mass in g
    "52": "2:8 2.5:8 3:6 3.5:5 4:3 4.5:3 5:3 5.5:4 6:10 8:20 10:40 12:60 14:80 16:100",
    "120.5": "3:15 3.5:10 4:10 4.5:10 4.75:10 5:10 5.5:8 6:4 6.5:6 7:10 10:20 12:40 14:70 16:100",
    "154": "3.5:15 4:15 4.5:15 5:8 5.5:4 6:3 6.5:6 7:10 7.5:20 10:60 12:80 14:100",
}
_TIME, _POWER = ("time in s", "angle in rad"), ("frequency in rad/s", "power in rad²")


def synthetic_figures(synthetic: Synthetic) -> list[ThesisFigure]:
    """Return Figures 3 to 8, of the synthetic robot."""
    robot, size, figures = synthetic.rig.robot.lumped, synthetic.sines[0].amplitude, []
    clean, noisy = (
        {s.omega: synthetic_log(synthetic, NO_ADDED_MASS, s, noise=noise) for s in synthetic.sines}
        for noise in (False, True)
    )
    for number, omega in ((3, 4.0), (4, 7.0)):
        log, expected = clean[omega], size * float(abs(LinearJoint.of(robot).response(omega)))
        seen = rms_amplitude(log.angle[steady_window(log, omega)])
        most = math.degrees(np.abs(log.angle).max())
        claims = [
            Claim(f"within ±{_SWING:g}° (here ±{most:.2f}°)", most <= _SWING),
            near("steady amplitude A|G(jω)| (20) of", 1e3 * expected, 1e3 * seen, " mrad"),
        ]
        curves = {"simulated": ("line", {"time_s": log.time, "angle_rad": log.angle})}
        title = f"Figure {number}: response to a sine of {omega:g} rad/s"
        figures.append(ThesisFigure(f"figure_{number:02d}", title, _TIME, curves, claims))
    time, angle = clean[4.0].time[:: tables.COARSE], clean[4.0].angle[:: tables.COARSE]
    dots, step = {"coarse_time_s": time, "coarse_angle_rad": angle}, float(np.diff(time).mean())
    both = {**figures[0].curves, "down-sampled": ("dots", dots)}
    title = "Figure 5: the response of Figure 3, down-sampled"
    claims = [near("a step of", _STEP, step, " s")]
    figures.append(ThesisFigure("figure_05", title, _TIME, both, claims, shown=(50, 60)))
    return [*figures, _leakage(angle, step, 4.0), *_gains(robot, clean, noisy)]


def _leakage(angle: Samples, step: float, omega: float) -> ThesisFigure:
    """Return Figure 6, whose window holds no whole periods: hence its flanks."""
    curves, shares = {}, []
    for kind, window in (("", _WINDOW), ("whole_", _WINDOW - _WINDOW % (2 * math.pi / omega))):
        bins, power = periodogram(angle[-math.floor(window / step) :], step)
        columns = {f"{kind}omega_rad_per_s": bins, f"{kind}power_rad2": power}
        curves[f"last {window:.4g} s"] = "line", columns
        shares.append(100 * (1 - np.sort(power)[-3:].sum() / power.sum()))
    bins, power = curves[f"last {_WINDOW:g} s"][1].values()
    others, away = len(_other_peaks(power)), f"{shares[0]:.2g} % of the power is beside three bins"
    why = f"{away}, {shares[1]:.1g} % in a window of whole periods: leakage"
    claims = [
        near("dominant frequency", omega, bins[power.argmax()], " rad/s", bins[0] / 2),
        Claim(f"several other peaks (here {others}; {why})", others > 1),
    ]
    title = f"Figure 6: periodogram of the last {_WINDOW:g} s of Figure 5"
    return ThesisFigure("figure_06", title, _POWER, curves, claims, {}, "y", (0, 3 * omega))


def _other_peaks(power: Samples) -> list[int]:
    """Return where (n,) powers have other local maxima than the largest, the larger first."""
    peaks = 1 + np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] > power[2:]))
    return sorted(peaks[power[peaks] < power.max()].tolist(), key=lambda k: -power[k])


def _gains(robot: LumpedParameters, *logs: Mapping[float, Log]) -> list[ThesisFigure]:
    """Return Figures 7 and 8, from the logs by frequency without and with noise."""
    omega, fine = np.array([*logs[0]]), np.linspace(0.5, 8.0, 400)
    gains = np.array(
        [[tables.scripted_point(log)[1] for log in responses.values()] for responses in logs]
    )
    quiet, loud = 10 ** (gains / 20)
    exact, line = (np.abs(LinearJoint.of(robot).response(w)) for w in (omega, fine))
    off, above = 100 * np.abs(quiet / exact - 1).max(), 100 * ((loud / quiet).max() - 1)
    tops, peak = [omega[gain.argmax()] for gain in (quiet, loud)], resonance_frequency(robot)
    crosses = "crosses", {"omega_rad_per_s": omega, "gain_without_noise": quiet}
    circles = "circles", {"omega_rad_per_s": omega, "gain_with_noise": loud}
    curve = "line", {"curve_omega_rad_per_s": fine, "linearisation_gain": line}
    axes = (_POWER[0], "gain in rad per unit of input")
    marks = {"(73)": peak, "(100) in Table 1": float(tables.TABLE_1_PRINTED[1].split()[0])}
    low, high = _PEAK
    seen = f"here at {tops[0]:g} and {tops[1]:g}; the resonance is {peak:.4g}"
    largest_at = f"both largest between {low} and {high} rad/s ({seen})"
    claims = [
        Claim(largest_at, low <= min(tops) <= max(tops) <= high),
        Claim(f"noise spoils the Bode plot (here by up to {above:.0f} %)", above > 100 * CLOSE),
    ]
    matches = [Claim(f"in good match (here within {off:.2g} %)", off < 100 * CLOSE)]
    both = {"without noise": crosses, "with noise": circles}
    bode = {"linearisation (63)": curve, "without noise": crosses}
    title = "Figure 7: gains (68) by (71), without and with noise"
    other = "Figure 8: gain of the linearisation, and gains without noise"
    return [
        ThesisFigure("figure_07", title, axes, both, claims, marks, "y"),
        ThesisFigure("figure_08", other, axes, bode, matches, marks, "y"),
    ]


def real_figures(root: Path | None) -> list[ThesisFigure]:
    """Return Figures 9 to 12, of the 41 real logs (see `has_real_logs`)."""
    manifest = read_manifest(shipped("experiments/real-logs.yaml"), root)
    logs = [read_entry(manifest, entry) for entry in manifest.logs]
    sines = [(log, log.excitation) for log in logs if log.excitation]
    log, sine = next((x, s) for x, s in sines if (x.added_mass.mass, s.omega) == _SHOWN)
    grid, rest, last = uniform_grid(log.time, _STEP), float(log.angle.mean()), float(log.time[-1])
    angle = resample(log.time, log.angle, grid)
    steady = angle[-round(_REAL_WINDOW / _STEP) :]
    bins, power = periodogram(steady - steady.mean(), _STEP)
    interval, top = 1e3 * np.diff(log.time), bins[power.argmax()]
    spread, typical = float(interval.std()), float(np.median(interval))
    levels = float(np.mean(np.abs(10 * interval - np.rint(10 * interval)) < 10 * CLOSE))
    below = next(k for k in _other_peaks(power) if bins[k] < top)
    share = power[below] / power.max()
    swing = {
        "measured": ("line", {"time_s": log.time, "angle_rad": log.angle}),
        "resampled": ("dots", {"coarse_time_s": grid, "coarse_angle_rad": angle}),
    }
    stamps = {"interval": ("dots", {"time_s": log.time[1:], "interval_ms": interval})}
    spectrum = {"measured": ("line", {"omega_rad_per_s": bins, "power_rad2": power})}
    swinging = [
        near("amplitude of the input", 0.1, rms_amplitude(log.input)),
        Claim(f"not centred (here about {rest:.2f} rad)", abs(rest) > CLOSE),
    ]
    stamped = [
        Claim(f"most slightly above 1 ms (here {typical:.3g} ms)", 1 < typical < _SLIGHTLY),
        Claim(f"stripes (here {100 * levels:.0f} % at multiples of 0.1 ms)", 2 * levels > 1),
        Claim(f"irregular (here {spread:.2g} ms rms)", spread > CLOSE * typical),
    ]
    seen = f"here one at {bins[below]:.3g} rad/s, with {100 * share:.1g} % of its power"
    dominant = [
        near("dominant frequency", sine.omega, top, " rad/s", bins[0] / 2),
        Claim(f"a peak below is not negligible ({seen})", share > CLOSE),
    ]
    title = f"Figure 9: response of the real hand, {1e3 * log.added_mass.mass:g} g"
    other = "Figure 10: intervals between the samples of Figure 9"
    third = f"Figure 11: periodogram of the last {_REAL_WINDOW:g} s of Figure 9"
    return [
        ThesisFigure("figure_09", title, _TIME, swing, swinging, shown=(last - 5, last)),
        ThesisFigure("figure_10", other, (_TIME[0], "interval in ms"), stamps, stamped),
        ThesisFigure("figure_11", third, _POWER, spectrum, dominant, logarithmic="y"),
        _real_gains(sines),
    ]


def _real_gains(sines: Sequence[tuple[Log, Sine]]) -> ThesisFigure:
    """Return Figure 12, with the resonances of Table 4 and the inputs of Table 3."""
    curves, resonances, low, recorded = {}, [], [], set()
    for mass in sorted({log.added_mass for log, _ in sines}):
        name, group = f"{1e3 * mass.mass:g}", [x for x in sines if x[0].added_mass == mass]
        omega, gain = np.transpose([method.scripted_amplitude(log) for log, _ in group])
        resonances.append(method.by_100(omega, gain))
        swings = [log.angle[steady_window(log, sine.omega)] for log, sine in group]
        excitations = np.array([(sine.omega, sine.amplitude) for _, sine in group])
        right = [rms_amplitude(swing - swing.mean()) for swing in swings] / excitations[:, 1]
        low += [*(20 * np.log10(right) - gain)]
        recorded |= {f"{name}:{sine.omega:g}:{1e3 * sine.amplitude:g}" for _, sine in group}
        columns = {f"omega_{name}g_rad_per_s": excitations[:, 0], f"gain_{name}g_dB": gain}
        curves[f"{name} g"] = "circles", columns
    printed = {f"{mass}:{pair}" for mass, row in _TABLE_3.items() for pair in row.split()}
    same, seen, published = len(recorded & printed), digits(resonances), tables.TABLE_4_PRINTED
    inputs = f"inputs are the {len(printed)} of Table 3 (here {len(recorded)}, {same} as there)"
    claims = [
        Claim(f"(100) of them is {published} rad/s (here {seen})", seen == published),
        near("they are lower than (71) by", 0, float(np.mean(low)), " dB", CLOSE),
        Claim(inputs, recorded == printed),
    ]
    marks = {f"Table 4, {k}": float(x) for k, x in zip(curves, published.split(), strict=True)}
    title = "Figure 12: gains (68) by (71) of the 41 logs, as scripted"
    return ThesisFigure("figure_12", title, (_POWER[0], "gain in dB"), curves, claims, marks)


def resonance_figure(robot: LumpedParameters) -> ThesisFigure:
    """Return errors of (86) to (100) without noise, wherever the peak is between two gains."""
    peak, linear = resonance_frequency(robot), LinearJoint.of(robot)
    top = float(abs(linear.response(peak))) ** 2
    ways: dict[str, tuple[str, Callable[[Samples, Samples], float]]] = {
        "(86) the largest": ("line", lambda w, g: float(method.largest(w, g)[0][0])),
        "(90)": ("crosses", lambda w, g: between(w, g, lambda x: np.sqrt(top + x**2))),
        "(100)": ("circles", method.by_100),
        "(89)": ("line", lambda w, g: method.parabola(w, g, (top * robot.p1 / robot.p4) ** 2)),
        "(90) with A − g²": ("line", lambda w, g: between(w, g, lambda x: np.sqrt(top - x**2))),
    }
    curves, finest = {}, []
    for name, (look, way) in ways.items():
        grids = (peak + spacing * _PLACES for spacing in _SPACINGS)
        off = [[way(w, np.abs(linear.response(w))) - peak for w in grid] for grid in grids]
        error = np.sqrt(np.mean(np.square(off), axis=1))
        curves[name] = look, {"spacing_rad_per_s": _SPACINGS, f"{name} in rad/s": error}
        finest.append(float(error[0]))
    rough, second, third, taylor, right = finest
    seen = f"here {second:.1g}, {third:.1g} rad/s; with A − g² {right:.1g}"
    ahead = f"(89) beats the largest gain (here {taylor:.1g} of {rough:.1g} rad/s)"
    claims = [
        Claim(ahead, taylor < rough),
        Claim(f"so do (90), (100) ({seen})", max(second, third) < (1 - CLOSE) * rough),
    ]
    title = "Resonance from gains without noise, by (86) to (100)"
    axes = ("spacing of the frequencies in rad/s", "rms error in rad/s")
    return ThesisFigure("resonance", title, axes, curves, claims, logarithmic="xy")


def regression_figure(synthetic: Synthetic, table_1: Row) -> ThesisFigure:
    """Return the bias of p1 by (82) and (84), beside errors of Table 1's last column."""
    robot, masses = synthetic.rig.robot.lumped, [*synthetic.added_masses] * _REPEATS
    inertia, moment = np.array([(m.inertia, m.gravity_moment) for m in masses]).T
    squares = (robot.p3 + moment) / (robot.p1 + inertia)  # (80)
    draws = np.random.default_rng(0).standard_normal((_DRAWS, squares.size))
    draws = 2 * np.sqrt(squares) * np.concatenate([draws, -draws])  # without odd powers of errors
    curves, last = {}, []
    for name, weight in method.WEIGHTS.items():
        estimates = [
            [method.regression(squares + e * d, masses, weight)[0] for d in draws] for e in _ERRORS
        ]
        bias = 100 * np.abs(np.mean(estimates, axis=1) / robot.p1 - 1)
        curves[name] = "line", {"error_rad_per_s": _ERRORS, f"{name} in %": bias}
        last.append(float(bias[-1]))
    variance = 4 * squares * _ERRORS[-1] ** 2
    spread = np.sum((squares - squares.mean()) ** 2) + variance.sum()
    law = 100 * float(np.sum(variance * (1 + inertia / robot.p1)) / spread)
    seen = f"here {last[1]:.2g} and {last[2]:.2g} %"
    without = f"(82), or distances that count both errors, have no such bias ({seen})"
    claims = [
        near("errors of its regressor shrink p1 by (84) by", law, last[0], " %", law / 10),
        Claim(without, max(last[1:]) < last[0] / 10),
    ]
    exact = [resonance_frequency(robot.with_added_mass(m)) for m in synthetic.added_masses]
    marks = {
        name: float(np.sqrt(np.mean((np.array(row.split(), float) - exact) ** 2)))
        for name, row in (("(100)", table_1.published), ("complex gains", table_1.corrected))
    }
    title = f"Bias of p1 by (82) and (84), from {_REPEATS} resonances of each mass"
    printed = "Dashed: how far Table 1's resonances are off by (100), "
    about = f"{printed}dotted: by a complex fit of the same data."
    axes = ("standard error of a resonance in rad/s", "size of the bias in %")
    return ThesisFigure("regression", title, axes, curves, claims, marks, "xy", about=about)


AMPLITUDE = np.pi / 3
"""Of the nominal motion in rad."""

_FIT_STEP = 1e-3  # s
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

        time = np.arange(0, _PERIODS * orbit.period, _FIT_STEP)
        start, span = [_START * AMPLITUDE, 0.0], (0.0, time[-1])
        angle, velocity = solve_ivp(rates, span, start, "DOP853", time, rtol=1e-10, atol=1e-12).y
        measured = angle + noise * np.random.default_rng(0).standard_normal(time.size)
        kinds = {"input_kind": InputKind.TORQUE, "intersample": Intersample.FIRST_ORDER_HOLD}
        log = Log(time, command(angle, velocity), measured, **kinds)  # type: ignore[arg-type]
        return cls(log=log, gamma=gamma, period=orbit.period)

    def residuals(self, values: LumpedParameters) -> Samples:
        """Return the (n,) differences in J of (118), with exponents along the motion: exact."""
        angle, reach = self.log.angle, round(VELOCITY_SHARE * HALF_WIDTH / _FIT_STEP)
        velocity = slope(angle, reach, 4, _FIT_STEP)
        area = cumulative_trapezoid(velocity**2, dx=_FIT_STEP, initial=0)
        excess = energy(values, angle, velocity) - energy(values, AMPLITUDE, 0.0)
        some = slice(None, None, round(self.period / _PARTS / _FIT_STEP))
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
