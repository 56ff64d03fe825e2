"""What is given of a robot: whether it sets the scale, and whether it agrees with the logs.

Where all logs carry the same, the equations are homogeneous: p1..p4 with the carried inertia and
moment fit as well times any factor. Noise in the regressors would bias least squares towards small
factors. The known value that determines the scale best is held in the fit, and given its
uncertainty after it (see `infer.with_held`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from butterfly.arrays import Samples, unit_columns
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.limits import (
    SINGULAR_CONDITION,
    Rival,
    cluster_covariance,
    half_widths,
)
from butterfly.identification.linearisation import Linearisation, scaled_least_squares
from butterfly.identification.stagewise import as_good
from butterfly.identification.trust import ACCUSED, CLEARLY, MATTERS, SHOWS, Finding, FindingKind
from butterfly.logs.log import Log
from butterfly.model.parameters import (
    AddedMass,
    JointKind,
    LumpedParameters,
    rounded,
    value_if_absent,
)
from butterfly.model.prior import LAG, NO_PRIOR, Known, Prior
from butterfly.model.terms import FOLLOWERS, OF_INPUT, PARAMETERS, SHARES, TERMS, companions

OF_SCALES: dict[str, dict[str, float]] = {
    "mass_scale": {},
    "gravity_scale": {},
    "input_scale": {
        row.name: float(power) for row in TERMS.values() if (power := -row.power_of("unit"))
    },
    "angle_scale": {  # of torques that grow with another power of the angle than that of inertia
        row.name: exponent
        for row in TERMS.values()
        if (row.basis or row.derivative) and (exponent := SHARES.get(row.name, 0.0) - row.angles)
    },
    "time_scale": {
        row.name: float(power) for row in TERMS.values() if (power := row.power_of("s"))
    },
}
"""Exponents with which parameters grow with a scale of `butterfly.model.prior.SCALES`."""

_OWN = Known(value=0.0)  # stands for what is known without a name

_OF_MASSES = {
    "mass_scale": (1.0, 1.0),
    "arm": (2.0, 1.0),
    "gravity_scale": (0.0, 1.0),
    "time_scale": (-2.0, 0.0),
}
"""Exponents with which a model's added inertia and added gravity moment grow with a scale."""

_LARGEST = 2 * MATTERS  # share by which a scale that is wrong unnoticed moves the values
_GREATEST = {"gravity_scale": 1.0}  # scales: no bench has more gravity for being out of level


def moved_by_givens(
    cells: Linearisation, carried: Sequence[AddedMass], known: Prior
) -> Samples | None:
    """Return the effect of uncertain added masses, arms and scales on the residuals of k cells.

    A mass that is off by dm adds dm (l^2 r_1 + g l r_3) to the residuals of its logs, an arm that
    is off by dl adds dl m (2 l r_1 + g r_3), with r_1 and r_3 their derivatives by p1 and p3. Equal
    masses are taken to be the same piece of metal, equal arms the same hole. A scale moves all
    masses, or the parameters that grow with it; a lag of the logger moves the delay.

    Of (k, m, n) rows it is (k, m, q) for q uncertain quantities, each times its standard
    uncertainty; None if all are exact. InputError if a parameter is known exactly although what is
    added to it, or drives it, is not.
    """
    count, values = cells.ends.size, cells.named
    inertia, gravity = (
        np.array([getattr(mass, name) for mass in carried] or np.zeros(count))
        for name in ("inertia", "gravity_moment")
    )
    moves: dict[tuple[str, float], Samples] = {}
    for position, added in enumerate(carried):
        for key, by_inertia, by_gravity in _moves(added):
            move = moves.setdefault(key, np.zeros((2, count)))
            move[:, position] = by_inertia, by_gravity
    columns = [_moved(cells, {"p1": pair[0], "p3": pair[1]}) for pair in moves.values()]
    for scale, share in known.scales.items():
        grows = OF_SCALES[scale]
        if "p4" in grows and "p4" in known.fixed:
            grows = grows | {"p4": np.nan}  # it is not among the names, and refused
        # what was recorded is less by the scale that the parameters grow with
        by = {name: np.full(count, -power * values.get(name, 0.0)) for name, power in grows.items()}
        of_inertia, of_gravity = _OF_MASSES.get(scale, (0.0, 0.0))
        by["p1"] = by.get("p1", 0.0) + of_inertia * inertia
        by["p3"] = by.get("p3", 0.0) + of_gravity * gravity
        columns.append(share * _moved(cells, by))
    late = known.values[LAG].uncertainty if LAG in known.values else 0.0
    if late and ("delay" in cells.names or "delay" in known.fixed):
        columns.append(late * _moved(cells, {"delay": np.ones(count)}))
    return np.stack(columns, axis=2) if columns else None


def _moved(cells: Linearisation, by: Mapping[str, Samples]) -> Samples:
    """Return (k, m) changes of the residuals if parameters change by (k,) amounts."""
    rows, _ = cells.stack
    result = np.zeros(rows.shape[:2])
    for name, change in by.items():
        if not change.any():
            continue
        if name not in cells.names:
            expected = f"exact masses and scales, or {name} with an uncertainty"
            raise InputError(
                "known", name, "exact although masses or scales are uncertain", expected
            )
        result += rows[:, :, cells.names.index(name)] * change[:, None]
    return result


def _moves(added: AddedMass) -> list[tuple[tuple[str, float], float, float]]:
    """Return the effects of a mass's and its arm's standard uncertainty on inertia and gravity."""
    uncertain = (
        ("mass", added.mass, added.mass_uncertainty, 1),
        ("arm", added.arm, added.arm_uncertainty, 2),
    )
    return [
        ((what, rounded(v)), power * u / v * added.inertia, u / v * added.gravity_moment)
        for what, v, u, power in uncertain
        if u and v
    ]


class ScaleRival(NamedTuple):
    """A scale that no log shows, which explains the logs as well as a fitted term."""

    term: str
    scale: str
    share: float  # by which p1 differs
    values: Samples  # (n,) without the term, the scale corrected
    slopes: Samples  # (n, n) derivatives of these by the values of the fit

    def rival(self, covariance: Samples, freedom: Samples) -> Rival:
        """Return its values, with half-widths by covariance and degrees of freedom of the fit."""
        return Rival(self.values, half_widths(self.slopes @ covariance @ self.slopes.T, freedom))


def open_scales(carried: Sequence[AddedMass], known: Prior, *, timed: bool) -> tuple[str, ...]:
    """Return the scales of added masses that were not given; a ``timed`` clock is right."""
    given = {
        "mass_scale": any(mass.mass_uncertainty for mass in carried),
        "arm": any(mass.arm_uncertainty for mass in carried) or not any(m.arm for m in carried),
        "time_scale": timed,
    }
    return tuple(s for s in _OF_MASSES if not (given.get(s) or s in known.values))


def scale_rivals(
    equations: Linearisation, masses: Sequence[AddedMass], known: Prior, *, timed: bool
) -> Iterator[ScaleRival]:
    """Yield the scales that may as well be wrong as a term be there.

    A scale and a term are alike where parameters that move by b times the scale's error undo its
    effect on the equations: the term, a share of what is given, is then absent at one error. Such
    values are as good as the fit, which it is not without the term, and of a scale that people get
    wrong unnoticed.
    """
    cells = equations.independent
    carried = [masses[number] for number in cells.log] if masses else []
    effects = _effects_of(cells, carried, open_scales(carried, known, timed=timed))
    moves = {scale: _undone(cells, effect) for scale, effect in effects.items()}
    for term, value in cells.named.items() if moves else ():
        if term not in TERMS or TERMS[term].unit != "–" or value == value_if_absent(term):
            continue
        if term in {*FOLLOWERS, *known.parameters} or _as_good_without(cells, term):
            continue
        for scale, (by, rest) in moves.items():
            at = cells.names.index(term)
            power = by[at] / (1 + value)
            if not abs(power) > MATTERS:
                continue
            error = (1 + value) ** (1 / power) - 1
            powers = np.array([OF_SCALES.get(scale, {}).get(name, 0.0) for name in cells.names])
            grown = np.where(np.arange(powers.size) == at, 0.0, (1 + error) ** powers)
            values = (cells.values - by * error) * grown
            slopes = np.diag(grown)
            slopes[:, at] += (powers * cells.values - by) * grown / by[at]
            share = float(values[cells.names.index("p1")] / cells.named["p1"] - 1)
            possible = 1 + error <= _GREATEST.get(scale, np.inf)
            possible &= value < 0 or abs(share) < _LARGEST
            if possible and _as_good(cells, cells.residuals + error * rest.ravel()):
                yield ScaleRival(term, scale, share, values, slopes)


def _effects_of(
    cells: Linearisation, carried: Sequence[AddedMass], scales: Sequence[str]
) -> dict[str, Samples]:
    """Return by scale the (k, m) derivatives of the residuals by it, with parameters fixed."""
    if not {"p1", "p3"} <= {*cells.names} or not any(mass.mass for mass in carried):
        return {}
    fitted = {name: value for name, value in cells.named.items() if name in TERMS}
    bare = LumpedParameters(**dict.fromkeys(PARAMETERS, 0.0) | fitted)
    loaded = [bare.with_added_mass(mass) for mass in carried]
    inertia = np.array([joint.p1 - bare.p1 for joint in loaded])
    gravity = np.array([joint.p3 - bare.p3 for joint in loaded])
    return {
        scale: _moved(cells, {"p1": powers[0] * inertia, "p3": powers[1] * gravity})
        for scale, powers in _OF_MASSES.items()
        if scale in scales
    }


def _undone(cells: Linearisation, effect: Samples) -> tuple[Samples, Samples]:
    """(n,) changes of values with an effect nearest to a (k, m) one, and what that leaves of it."""
    rows, residuals = cells.with_prior
    rows = np.where(cells.free, rows, 0.0)
    wanted = np.zeros(residuals.size)
    wanted[: effect.size] = effect.ravel()
    by = scaled_least_squares(rows, wanted)
    return by, effect - (cells.stack[0] @ by)


def _as_good_without(cells: Linearisation, term: str) -> bool:
    """Whether the equations are solved as well without a term."""
    names = np.array(cells.names)
    lost = np.where(names == term, value_if_absent(term) - cells.values, 0.0)
    rows, residuals = cells.with_prior
    mask = cells.free & ~np.isin(names, [term, *companions({term})])
    step = lost + scaled_least_squares(np.where(mask, rows, 0.0), -(residuals + rows @ lost))
    return _as_good(cells, cells.residuals + cells.rows @ step)


def _as_good(cells: Linearisation, residuals: Samples) -> bool:
    """Whether residuals of all cells are as small as those of the equations."""
    errors = np.linalg.norm(residuals.reshape(cells.ends.size, -1), axis=1)
    return as_good((1 - SHOWS) * errors, np.sqrt(cells.squares))


def prior_contradictions(
    cells: Linearisation, covariance: Samples, known: Prior = NO_PRIOR
) -> list[Finding]:
    """Return the priors that the logs contradict, by the (n, n) covariance of the estimate.

    The estimate less the prior has the variance C + s - 2 v N, with C that of the estimate, s that
    of the prior, N the inverse of the normal equations and v the variance of a row. A finding on
    what is assumed, a guess among the ``known``, says what that is; on a motor's value, whose.
    """
    prior, (rows, _) = cells.prior, cells.with_prior
    if prior is None:
        return []
    scaled, scale = unit_columns(rows)
    normal = np.diag(np.linalg.inv(scaled.T @ scaled)) / scale**2
    findings = []
    for k in np.flatnonzero(prior.active).tolist():
        given = prior.variance / prior.weight[k]
        variance = float(covariance[k, k] + given - 2 * prior.variance * normal[k])
        if variance < MATTERS**2 * given:
            continue  # the logs have no information on the parameter
        distance = float(abs(cells.values[k] - prior.mean[k]) / np.sqrt(variance))
        if distance > CLEARLY:
            guess = known.values.get(cells.names[k], _OWN)
            kind = FindingKind.MOTOR_CONFLICT if guess.origin else FindingKind.PRIOR_CONFLICT
            whose = [guess.origin or str(guess)] if guess.heavy or guess.origin else []
            findings.append(Finding(kind, (cells.names[k], *whose), number=distance))
    return findings


def scale_errors(cells: Linearisation, carried: Sequence[AddedMass], known: Prior) -> list[Finding]:
    """Return whether the added masses of k cells contradict parameters that are known exactly.

    Residuals do not change with a common factor of all torques: their derivative by a factor of the
    known ones is minus that by one of all others. Its step is the factor that the logs support.
    """
    fixed = tuple(name for name in known.scale() if name in known.fixed)
    names, (rows, residuals) = cells.names, cells.stack
    lost = any(load and n not in names for mass in carried for n, load in mass.loads.items())
    if not fixed or lost or len({mass.inertia_and_moment for mass in carried}) <= 1:
        return []
    grown = np.array([growth(names, cells.values, mass) for mass in carried])
    column = -np.einsum("kmn,kn->km", rows, grown)
    whole = np.concatenate([rows, column[:, :, None]], axis=2)
    flat, size = unit_columns(whole.reshape(-1, len(names) + 1))
    if np.linalg.cond(flat) > SINGULAR_CONDITION:
        return []
    step = np.linalg.lstsq(flat, -residuals.ravel(), rcond=None)[0] / size
    covariance, freedom = cluster_covariance(whole, residuals + whole @ step)
    share, error = float(step[-1]), float(np.sqrt(covariance[-1, -1]))
    quantile = float(stdtrit(freedom[-1], 1 - ACCUSED / 2))
    if abs(share) <= max(quantile * error, MATTERS):
        return []
    return [Finding(FindingKind.KNOWN_CONFLICT, fixed, number=share)]


def is_driven(logs: Iterable[Log]) -> bool:
    """Whether any input is not 0."""
    return any(bool(np.any(log.input)) for log in logs)


def prior_of_fit(logs: Sequence[Log], known: Prior) -> Prior:
    """Return the prior of a fit of logs, with a guess of the delay, and a scale.

    IdentifiabilityError if nothing sets the scale.
    """
    step = float(np.median([log.mean_step for log in logs]))
    masses = [log.added_mass for log in logs]
    return with_scale(masses, known.with_default_delay(step), driven=is_driven(logs))


def with_scale(masses: Iterable[AddedMass], known: Prior, *, driven: bool = True) -> Prior:
    """Return the prior, with the uncertain parameter held that alone sets the scale, if any.

    IdentifiabilityError without two different masses, or a torque that is known, not 0.
    """
    if not driven and not {*OF_INPUT} <= known.fixed.keys():
        raise IdentifiabilityError(
            "the input is always zero, so p4 and delay are not identifiable: add logs of the "
            "driven joint, or give both (--known p4=...,delay=0)"
        )
    carried = sorted(set(masses))
    if len({mass.inertia_and_moment for mass in carried}) > 1:
        return known
    torques = known if driven else known.within(known.parameters.keys() - {"p4"})
    if not torques.scale(carried[0]):
        same = "all logs have the same" if carried[0].mass else "no log has an"
        raise IdentifiabilityError(
            f"{same} added mass, so p1..p4 are identifiable only up to a common factor: "
            f"{'; or '.join(_remedies(carried[0], driven=driven))}"
        )
    name = torques.reference(carried[0])
    return known if name is None else known.holding(name)


def _remedies(carried: AddedMass, *, driven: bool) -> list[str]:
    """Return what would determine the scale of logs that all carry the same, in words."""
    slide = carried.joint is JointKind.SLIDE
    other = "another known mass, or with none" if carried.mass else "a known mass"
    remedies = [f"add a log with {other}"]
    if driven:
        force = "N" if slide else "N m"
        motor = "resistance=...,torque_constant=..." + (",gear_ratio=..." if slide else "")
        remedies.append(
            f"give p4, in {force} per unit of input: --known p4=1 for a command in {force}, "
            f"--known {motor} for a motor driven by a voltage"
        )
    if carried.gravity:
        remedies.append(
            "give p3: --known p3=..., the joint's weight in N times l_c in m"
            + (", 0 if it is balanced" if carried.gravity_moment else "")
        )
    remedies.append(f"give p1: --known p1=..., in {'kg' if slide else 'kg m²'}")
    return remedies


def growth(names: Sequence[str], values: Samples, added: AddedMass) -> Samples:
    """Return the (n,) derivatives of (n,) values by a common factor of all torques."""
    shares = [SHARES.get(name, 0.0) for name in names]
    return np.array([added.loads.get(name, 0.0) for name in names]) + values * shares
