"""The thesis's ways from gains to a resonance (86)-(90), and from resonances to p1, p3 (82), (84).

They are here to be measured beside better ones; best is one complex fit to all gains.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import least_squares

from butterfly.arrays import Samples
from butterfly.model.linear import Linearisation, resonance_frequency
from butterfly.model.parameters import AddedMass
from butterfly.thesis.claims import CLOSE, Claim, ThesisFigure, near
from butterfly.thesis.method import between, by_100, largest
from butterfly.thesis.tables import Row, Synthetic

WEIGHTS: dict[str, Callable[[float, Samples], Samples]] = {
    "(84) linear": lambda _, inertia: np.ones(inertia.size),
    "(82) nonlinear": lambda p1, inertia: 1 / (p1 + inertia),
    "(84) orthogonal distance": lambda p1, inertia: 1 / np.hypot(p1, inertia),
}
"""Weights of the equations Y (p1 + Z) = p3 + X of (84), given p1 and (n,) Z.

Linear regression has none, although the errors of Y are in its regressor: that shrinks p1. Divided
by p1 + Z their errors are those of (82). Distances (ODRPACK) to the line count the errors of Y and
Z Y as independent, the true abscissae eliminated.
"""

_ERRORS = np.geomspace(3e-4, 0.3, 7)  # rad/s, of resonances
_REPEATS, _DRAWS = 20, 10  # resonances of each mass, and how often they are drawn
_SPACINGS, _PLACES = np.geomspace(0.01, 0.5, 9), 20  # rad/s between gains, places of the peak
_AROUND = np.arange(-6, 7)


def parabola(omega: Samples, gain: Samples, curvature: float) -> float:
    """Return the resonance in rad/s by (89), from the two largest gains.

    Next to its peak |G|^2 is A - B (w^2 - w_opt^2)^2; the ``curvature`` B has to be known.
    """
    w, g = largest(omega, gain)
    x, y = w**2, g**2
    return math.sqrt(max(x.mean() + (y[0] - y[1]) / (x[0] - x[1]) / (2 * curvature), 0.0))


def regression(
    squares: Samples, masses: Sequence[AddedMass], weight: Callable[[float, Samples], Samples]
) -> Samples:
    """Return p1 in kg m^2, p3 in N m by (n,) squared resonances Y in rad^2/s^2 and `WEIGHTS`."""
    inertia, moment = np.array([(mass.inertia, mass.gravity_moment) for mass in masses]).T
    rows = np.column_stack([-squares, np.ones(squares.size)])
    start = np.linalg.lstsq(rows, squares * inertia - moment)[0]

    def errors(values: Samples) -> Samples:
        left = squares * (values[0] + inertia) - values[1] - moment
        return np.asarray(left * weight(values[0], inertia))

    return np.asarray(least_squares(errors, start, x_scale=np.abs(start), gtol=1e-14).x)


def regression_figures(synthetic: Synthetic, table_1: Row) -> list[ThesisFigure]:
    """Return errors of the resonance, and of p1, beside those of Table 1's last column."""
    return [_over_spacing(synthetic), _over_error(synthetic, table_1)]


def _over_spacing(synthetic: Synthetic) -> ThesisFigure:
    """Errors of (86) to (100) without noise, wherever the peak is between two gains."""
    robot = synthetic.rig.robot.lumped
    peak, linear = resonance_frequency(robot), Linearisation.of(robot)
    top = float(abs(linear.response(peak))) ** 2
    ways: dict[str, Callable[[Samples, Samples], float]] = {
        "(86) the largest": lambda w, g: float(largest(w, g)[0][0]),
        "(90)": lambda w, g: between(w, g, lambda each: np.sqrt(each**2 + top)),
        "(100)": by_100,
        "(89)": lambda w, g: parabola(w, g, (top * robot.p1 / robot.p4) ** 2),
        "(90) with A − g²": lambda w, g: between(w, g, lambda each: np.sqrt(top - each**2)),
    }
    places, curves, finest = _AROUND + (np.arange(_PLACES)[:, None] + 0.5) / _PLACES, {}, []
    for (name, way), look in zip(
        ways.items(), ("line", "crosses", "circles", "line", "line"), strict=True
    ):
        grids = (peak + spacing * places for spacing in _SPACINGS)
        off = [[way(w, np.abs(linear.response(w))) - peak for w in grid] for grid in grids]
        error = np.sqrt(np.mean(np.square(off), axis=1))
        curves[name] = (look, {"spacing_rad_per_s": _SPACINGS, f"{name} in rad/s": error})
        finest.append(float(error[0]))
    rough, *printed, taylor, right = finest
    claims = [
        Claim(
            f"(89) beats the largest gain (here {taylor:.1g} of {rough:.1g} rad/s)", taylor < rough
        ),
        Claim(
            f"so do (90), (100) (here {printed[0]:.1g}, {printed[1]:.1g} rad/s; with A − g² "
            f"{right:.1g})",
            max(printed) < (1 - CLOSE) * rough,
        ),
    ]
    title = "Resonance from gains without noise, by (86) to (100)"
    axes = ("spacing of the frequencies in rad/s", "rms error in rad/s")
    return ThesisFigure("resonance", title, axes, curves, claims, logarithmic="xy")


def _over_error(synthetic: Synthetic, table_1: Row) -> ThesisFigure:
    """Bias of p1 by (82) and (84), over the error of the resonances."""
    robot, masses = synthetic.rig.robot.lumped, [*synthetic.added_masses] * _REPEATS
    inertia, moment = np.array([(mass.inertia, mass.gravity_moment) for mass in masses]).T
    squares = (robot.p3 + moment) / (robot.p1 + inertia)  # (80)
    draws = np.random.default_rng(0).standard_normal((_DRAWS, squares.size))
    draws = 2 * np.sqrt(squares) * np.concatenate([draws, -draws])  # without odd powers of errors
    curves, last = {}, []
    for name, weight in WEIGHTS.items():
        found = [[regression(squares + e * d, masses, weight)[0] for d in draws] for e in _ERRORS]
        bias = 100 * np.abs(np.mean(found, axis=1) / robot.p1 - 1)
        curves[name] = ("line", {"error_rad_per_s": _ERRORS, f"{name} in %": bias})
        last.append(float(bias[-1]))
    variance = 4 * squares * _ERRORS[-1] ** 2
    spread = np.sum((squares - squares.mean()) ** 2) + variance.sum()
    law = 100 * float(np.sum(variance * (1 + inertia / robot.p1)) / spread)
    claims = [
        near("errors of its regressor shrink p1 by (84) by", law, last[0], " %", law / 10),
        Claim(
            "(82), or distances that count both errors, have no such bias (here "
            f"{last[1]:.2g} and {last[2]:.2g} %)",
            max(last[1:]) < last[0] / 10,
        ),
    ]
    exact = [resonance_frequency(robot.with_added_mass(m)) for m in synthetic.added_masses]
    marks = {
        name: float(np.sqrt(np.mean((np.array(row.split(), dtype=float) - exact) ** 2)))
        for name, row in (("(100)", table_1.published), ("complex gains", table_1.corrected))
    }
    title = f"Bias of p1 by (82) and (84), from {_REPEATS} resonances of each mass"
    about = (
        "Dashed: how far Table 1's resonances are off by (100), dotted: by a complex fit of the "
        "same data."
    )
    axes = ("standard error of a resonance in rad/s", "size of the bias in %")
    return ThesisFigure("regression", title, axes, curves, claims, marks, "xy", about=about)
