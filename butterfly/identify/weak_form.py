"""The weak form: the equation of motion against test functions, linear in the parameters.

Multiplied by a bump phi(t - c) and integrated by parts, (78) needs neither velocity nor
acceleration of the angle th:

    (p1 + Z) int phi'' th - p2 int phi' th + (p3 + X) int phi sin th + T_c int phi sgn thd + ...
        = p4 int phi u(t - d)

so every trajectory will do, not sines alone (Shinbrot, Trans. ASME 79, 1957; Messenger & Bortz,
J. Comput. Phys. 443, 2021). The bump is (1 - s^2)^4. Only the friction terms need a velocity, from
local polynomials; windows in which the joint sticks are left out, since friction is then not a
function of the motion. The delay enters as p4 d int phi' u, about the current one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import lsq_linear

from butterfly.errors import InputError, nearest
from butterfly.identify.covariance import cluster_covariance, compress
from butterfly.identify.estimate import PARAMETERS, ParameterEstimate, lower_bounds
from butterfly.identify.identifiability import Conditioning, refuse_one_mass, sort_by_precision
from butterfly.identify.intervals import honest_limits, without_each_mass
from butterfly.identify.weak_signals import HALF_WIDTH, weak_signals

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from butterfly.logs.log import Log
    from butterfly.model.parameters import AddedMass

METHOD = "weak form"

TERMS = ("drag", "load", "bias", "p3_offset", "stribeck", "cogging", "cogging_cosine")
"""What can be estimated besides `PARAMETERS`; Stribeck velocity and cogging periods are held."""

_ROUNDS = 8  # about the delay
_SETTLED = 1e-7  # s


@dataclass(frozen=True, eq=False)
class _Windows:
    """One log's (m, n) regressors and (m,) targets, divided by the log's rms inertial term."""

    rows: NDArray[np.float64]
    target: NDArray[np.float64]


def fit_weak_form(
    logs: Sequence[Log],
    zeros: Mapping[AddedMass, float],
    terms: tuple[str, ...] = ("drag",),
    *,
    half_width: float = HALF_WIDTH,
) -> ParameterEstimate:
    """Estimate p1..p4, Coulomb torque, delay and terms by linear least squares.

    Parameters
    ----------
    logs
        Of any input, of at least two different added masses (none counts as one).
    zeros
        Encoder reading in rad of the hand at rest, per added mass.
    terms
        Of `TERMS`.
    half_width
        Of the test functions, in s.

    Raises
    ------
    IdentifiabilityError
        If the logs cannot determine the parameters.
    InputError
        If there is no such term, or a log is shorter than a test function.
    """
    for term in terms:
        if term not in TERMS:
            raise InputError(METHOD, "terms", term, nearest(term, TERMS))
    refuse_one_mass(log.added_mass for log in logs)
    names = (*PARAMETERS, *terms)
    values, windows, on_bound = _solve(logs, zeros, names, half_width)
    late = names.index("delay")
    compressed = []
    for window in windows:
        rows = window.rows.copy()
        rows[:, late] *= values[names.index("p4")]  # of the delay itself, not of p4 times it
        residual = rows @ values - window.target - rows[:, late] * values[late]
        compressed.append(compress(rows, residual))
    rows, residuals = (np.array(part) for part in zip(*compressed, strict=True))
    conditioning = Conditioning.of(rows.reshape(-1, len(names)), names)
    conditioning.refuse_singular()
    covariance, freedom = cluster_covariance(rows, residuals)

    def without(mass: AddedMass) -> NDArray[np.float64]:
        kept = [log for log in logs if log.added_mass != mass]
        return _solve(kept, zeros, names, half_width)[0]

    left_out = without_each_mass((log.added_mass for log in logs), without)
    lower, upper = honest_limits(values, covariance, freedom, left_out.values())
    lower = np.maximum(lower, lower_bounds(names))
    bounded = tuple(np.array(names)[on_bound].tolist())
    verdict = [sort_by_precision(values, lower, upper, names), *conditioning.words()]
    if bounded:
        verdict.append(f"{', '.join(bounded)} ended on the bound 0: not seen in the data.")
    return ParameterEstimate(
        method=METHOD,
        names=names,
        values=values,
        covariance=covariance,
        lower=lower,
        upper=upper,
        left_out=left_out,
        condition=conditioning.number,
        on_bound=bounded,
        verdict=tuple(verdict),
    )


def _solve(
    logs: Sequence[Log], zeros: Mapping[AddedMass, float], names: Sequence[str], half_width: float
) -> tuple[NDArray[np.float64], list[_Windows], NDArray[np.bool_]]:
    """Return values, the windows about their delay, and which values are on a bound."""
    delay, values = 0.0, np.zeros(len(names))
    gain, late = names.index("p4"), names.index("delay")
    for _ in range(_ROUNDS):
        windows = [_windows(log, zeros[log.added_mass], names, half_width, delay) for log in logs]
        rows = np.concatenate([w.rows / w.target.size**0.5 for w in windows])
        target = np.concatenate([w.target / w.target.size**0.5 for w in windows])
        scale = np.linalg.norm(rows, axis=0)
        bounds = (lower_bounds(names), np.inf)
        fit = lsq_linear(rows / scale, target, bounds=bounds, method="bvls", tol=1e-14)
        values = fit.x / scale
        step = values[late] / values[gain]
        delay += step
        if abs(step) < _SETTLED:
            break
    values[late] = delay
    return values, windows, np.asarray(fit.active_mask != 0)


def _windows(
    log: Log, zero: float, names: Sequence[str], half_width: float, delay: float
) -> _Windows:
    period = 2 * np.pi / log.excitation.omega if log.excitation else np.inf
    signals = weak_signals(log, zero, min(half_width, period / 4), delay)
    moving = signals.moving
    rows = np.column_stack([signals.mean[name][moving] for name in names])
    inertia, gravity = rows[:, names.index("p1")], rows[:, names.index("p3")]
    size = float(np.sqrt(np.mean(inertia**2))) if inertia.size else 1.0
    known = log.added_mass.inertia * inertia + log.added_mass.gravity_moment * gravity
    return _Windows(rows=rows / size, target=-known / size)
