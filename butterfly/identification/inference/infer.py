"""From the equations of a fit to its estimate: covariance, intervals, agreement, findings."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from butterfly.arrays import Samples, unit_diagonal
from butterfly.errors import IdentifiabilityError
from butterfly.identification.blocks import Conditions
from butterfly.identification.diagnostics.findings import Ending, Finding, FindingKind
from butterfly.identification.equations import CellEquations, scaled_least_squares
from butterfly.identification.estimate import OF_VERDICT, Estimate
from butterfly.identification.inference.agreement import disagreements_of, weighed_within
from butterfly.identification.inference.consistency import (
    disagreements,
    moved_by_givens,
    scale_apart,
)
from butterfly.identification.inference.covariance import (
    cluster_covariance,
    half_widths,
    honest_limits,
    robust,
)
from butterfly.identification.inference.identifiability import (
    Conditioning,
    precision,
    refuse_without_scale,
)
from butterfly.identification.inference.submodels import without_logs
from butterfly.identification.levels import CLEARLY, FEW, LOST, PRECISE
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import NO_PRIOR, Prior
from butterfly.model.terms import TERMS

_NOTHING = np.finfo(float).tiny ** 0.5


def infer(
    equations: CellEquations,
    *,
    method: str,
    unweighted: CellEquations | None = None,
    masses: Sequence[AddedMass] = (),
    conditions: Conditions | None = None,
    left_out: Mapping[Hashable, Samples] | None = None,
    driven: bool = True,
    rivals: Sequence[Samples] = (),
    shared: int | None = None,
    findings: Sequence[Finding] = (),
    fixed: dict[str, float] | None = None,
    local: dict[AddedMass | str | None, dict[str, float]] | None = None,
    horizon: float | None = None,
    known: Prior = NO_PRIOR,
    besides: Samples | None = None,
    torques: bool = False,
    ratios: bool = False,
) -> Estimate:
    """Judge a solver's end: conditioning, covariance, intervals, agreement, bounds, findings.

    ``unweighted``: the equations of cells before their logs were weighed as wholes, in which
    agreement is seen; ``masses``: what each log carried; ``conditions``: under which the cells
    were recorded; ``left_out``: estimates from parts of the data, those without one added mass if
    not given; ``rivals``: other fits that predict as well; both widen the intervals. The first
    ``shared`` values are the robot's; ``besides`` is an (n, n) covariance of what was taken as
    given, added to that of the equations; ``torques`` says that the residuals are such, whose size
    is weighed beside what each value does. IdentifiabilityError says that the equations are
    singular for every practical purpose.
    """
    cells = equations.independent
    whole, left = cells.with_prior
    active = None if equations.prior is None else equations.prior.active
    flat = cells.rows.reshape(-1, len(cells.names))
    conditioning = Conditioning.of(flat, equations.names, active)
    conditioning.refuse_singular()
    about = unweighted or equations
    contrasts, of_conditions = (
        ((), ()) if conditions is None else disagreements_of(about, conditions)
    )
    shift = equations.values - about.values
    share = weighed_within(contrasts)
    weighed = [  # none better than the masses tell of each other
        replace(each, mass_uncertainty=max(each.mass_uncertainty, share * each.mass))
        for each in masses
    ]
    carried = [weighed[number] for number in cells.log] if masses else []
    considered = moved_by_givens(cells, carried, known)
    covariance, freedom = cluster_covariance(cells.rows, cells.residuals, cells.prior, considered)
    if equations.bread is not None:
        covariance = robust(covariance, whole.T @ whole, equations.bread)
    if besides is not None:
        covariance = covariance + besides
    apart = [
        *disagreements(cells.prior, cells.names, cells.values, covariance, whole),
        *scale_apart(cells, known, carried),
    ]
    if left_out is None:
        left_out, few = without_each_mass(equations, masses, known, driven=driven)
        apart += few
    own = slice(shared)
    names, values = equations.names[own], equations.values[own]
    scatter = covariance[own, own]
    partial = {key: each[own] for key, each in left_out.items()}
    limits = honest_limits(values, scatter, freedom[own], partial.values(), rivals)
    most = half_widths(scatter, freedom[own])
    for rival in of_conditions:
        end, reach = (rival.values + shift)[own], np.minimum(rival.reach[own], most)
        limits = np.minimum(limits[0], end - reach), np.maximum(limits[1], end + reach)
    if torques:
        limits = outweighed(misfit_over_value(equations)[own], values, limits, names)
    on_bound = tuple(np.array(names)[equations.on_bound[own]].tolist())
    # which the equations would have well below their values, were there no bound
    below = scaled_least_squares(whole, left) > CLEARLY * np.sqrt(np.diag(covariance))
    pulled = set(np.array(names)[below[own]].tolist())
    ending, moved = equations.ending, equations.unsettled
    if moved is not None and (np.abs(moved[own]) <= PRECISE * (limits[1] - limits[0]) / 2).all():
        ending = Ending.CONVERGED
    logs = np.unique(equations.log).size
    return Estimate(
        method=method,
        names=names,
        values=values,
        covariance=scatter,
        lower=np.maximum(limits[0], equations.lower[own]),
        upper=limits[1],
        left_out=partial,
        condition=conditioning.number,
        on_bound=on_bound,
        ending=ending,
        findings=(
            *conditioning.findings,
            *_of_bounds_and_signs(names, on_bound, pulled),
            *apart,
            # blocks of time vary less than logs do
            *([Finding(FindingKind.FEW_LOGS, number=logs)] if masses and logs <= FEW else ()),
            *findings,
        ),
        fixed=known.fixed | (fixed or {}),
        local=local or {},
        agreement=contrasts,
        known=known,
        rivals=tuple(rivals),
        horizon=horizon,
        freedom=freedom[own],
        ratios=ratios,
    )


def without_each_mass(
    equations: CellEquations, masses: Sequence[AddedMass], known: Prior, *, driven: bool
) -> tuple[dict[Hashable, Samples], list[Finding]]:
    """Estimate to first order without each mass, if the rest tells the scale; else say so."""
    different = sorted({masses[number] for number in np.unique(equations.log)}) if masses else []
    left_out: dict[Hashable, Samples] = {}
    sure = known.within(known.fixed)
    for mass in different if len(different) > 1 else ():
        try:
            refuse_without_scale(
                [other for other in different if other != mass], sure, driven=driven
            )
        except IdentifiabilityError:
            continue
        lost = [number for number, own in enumerate(masses) if own == mass]
        values = without_logs(equations, lost)
        if np.isfinite(values).all():
            left_out[mass] = values
    few = Finding(FindingKind.FEW_MASSES, number=len(different))
    return left_out, [] if not masses or left_out or known.scale(different[0]) else [few]


def _of_bounds_and_signs(
    names: Sequence[str], on_bound: Sequence[str], pulled: set[str]
) -> list[Finding]:
    """Say what a bound holds, and whether the data would go far beyond; and unseen signs."""
    groups = (
        (FindingKind.PULLED, [name for name in on_bound if name in pulled]),
        (FindingKind.ON_BOUND, [name for name in on_bound if name not in pulled]),
        (FindingKind.SIGN_UNKNOWN, [n for n in names if not TERMS[n].sign_observable]),
    )
    return [Finding(kind, tuple(own)) for kind, own in groups if own]


def misfit_over_value(equations: CellEquations) -> Samples:
    """(n,) R = |r| / (|p| |s|), with s the column of a value less what the others explain.

    Standard errors take what a fit leaves for noise; where it is as large as what a parameter alone
    does to the rows, a misfit may have made the value: a ripple of the velocity is read as inertia.
    """
    scaled, size = unit_diagonal(equations.curvature.sum(axis=0))
    alone = size / np.sqrt(np.diag(np.linalg.pinv(scaled)))
    effect, left = np.abs(equations.values) * alone, np.sqrt(equations.cost.sum())
    most = np.full(effect.size, np.finfo(float).max)
    return np.asarray(np.divide(left, effect, out=most, where=effect > left * _NOTHING))


def outweighed(
    misfit: Samples, values: Samples, limits: tuple[Samples, Samples], names: Sequence[str]
) -> tuple[Samples, Samples]:
    """Return (n,) limits that hold what a misfit may have made of scale, or precise values."""
    claims = precision(values, *limits)
    doubted = [n in OF_VERDICT or c == "precise" for n, c in zip(names, claims, strict=True)]
    reach = np.where(np.array(doubted) & (misfit > LOST), misfit * np.abs(values), 0.0)
    return np.minimum(limits[0], values - reach), np.maximum(limits[1], values + reach)
