"""From the equations of a fit to its estimate: covariance, intervals, agreement, findings."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import IdentifiabilityError
from butterfly.identification.agreement import (
    Conditions,
    Contrast,
    disagreements_of,
    weighed_within,
)
from butterfly.identification.consistency import (
    ScaleRival,
    growth,
    moved_by_givens,
    prior_contradictions,
    scale_errors,
    scale_rivals,
    with_scale,
)
from butterfly.identification.estimate import Estimate
from butterfly.identification.fit import Fit
from butterfly.identification.limits import (
    Evidence,
    Rival,
    cluster_covariance,
    half_widths,
    misfit_over_value,
    robust,
)
from butterfly.identification.linearisation import Linearisation, scaled_least_squares
from butterfly.identification.scatter import without_logs
from butterfly.identification.trust import CLEARLY, FEW, LOST, Ending, Finding, FindingKind
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import NO_PRIOR, Penalty, Prior
from butterfly.model.terms import OF_SCALE, PARAMETERS, TERMS

_SURE = 0.1  # relative half-width, times `CLEARLY`, below which a value looks sure
_LAST_STEP = 0.1  # of a half-width, which a fit that converged may still move

Pair: TypeAlias = tuple[Samples, Samples]
"""An (n, n) covariance and its (n,) degrees of freedom."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Basis:
    """What inference knows beside the fit of n values, whose equations are in cells.

    A known value that was held, as it sets the scale, is not among the n.
    """

    method: str
    shared: int | None = None  # number of the first values, the robot's parameters; None: all
    masses: Sequence[AddedMass] = ()  # one per log
    conditions: Conditions | None = None  # of the cells
    known: Prior = NO_PRIOR  # of the robot
    driven: bool = True  # whether any input is not 0
    timed: bool = False  # whether sines of known frequency show the clock
    # (n,) estimates from parts of the data; None: those without each added mass
    left_out: Mapping[Hashable, Samples] | None = None
    rivals: Sequence[Rival] = ()  # other (shared,) values that may be right
    consider_covariance: Samples | None = None  # (n, n), by errors of quantities taken as given
    torques: bool = False  # whether residuals are torques, so that a misfit may bias any value
    large: bool = False  # whether most of the error is no noise
    fixed: dict[str, float] = field(default_factory=dict)  # values that were not fitted
    findings: Sequence[Finding] = ()  # of the method

    def carried(self, log: NDArray[np.intp], share: float) -> list[AddedMass]:
        """Return the masses of cells, by their logs, uncertain by ``share`` or more."""
        weighed = [
            replace(mass, mass_uncertainty=max(mass.mass_uncertainty, share * mass.mass))
            for mass in self.masses
        ]
        return [weighed[number] for number in log] if weighed else []


def _with_scale(fit: Fit, basis: Basis) -> tuple[Fit, Basis]:
    """Return fit and basis with the value held for the scale, and its prior, among the n."""
    name, given, consider = basis.known.held, basis.known.given, basis.consider_covariance
    if name is None:
        return fit, replace(basis, known=given)
    whole = with_held(fit, name, basis.known, basis.masses[0])
    at, value = whole.linearisation.names.index(name), basis.known.fixed[name]
    if consider is not None:
        consider = np.insert(np.insert(consider, at, 0.0, axis=0), at, 0.0, axis=1)
    return whole, replace(
        basis,
        shared=None if basis.shared is None else basis.shared + 1,
        known=given,
        rivals=[rival.inserted(at, value) for rival in basis.rivals],
        consider_covariance=consider,
    )


def infer(ended: Fit, about: Basis) -> Estimate:
    """Return the estimate of a fit: values with covariance, intervals, agreement and findings.

    IdentifiabilityError if the equations are singular for every practical purpose.
    """
    fit, basis = _with_scale(ended, about)
    equations, cells = fit.linearisation, fit.linearisation.independent
    known, robot = basis.known, slice(basis.shared)
    names, fixed = equations.names[robot], known.fixed | basis.fixed
    conditioning = cells.conditioning
    conditioning.require()
    contrasts, disagreeing = agreement_of(fit, basis)
    scales = [*scale_rivals(equations, basis.masses, known, timed=basis.timed)]
    carried = basis.carried(cells.log, weighed_within(contrasts))
    covariance, freedom = covariance_of(fit, basis, carried)
    left_out, few = without_each_mass(equations, basis)
    count = np.unique(equations.log).size  # of logs; stretches of time vary less
    if basis.masses and count <= FEW:
        few = [*few, Finding(FindingKind.FEW_LOGS, number=count)]
    half = half_widths(covariance, freedom)
    rivals = (
        *basis.rivals,
        *(scale.rival(covariance, freedom).within(robot) for scale in scales),
        *(rival.at_most(half).within(robot) for rival in disagreeing),
    )
    values = equations.values[robot]
    evidence = Evidence(
        values=values,
        half=half[robot],
        least=equations.lower[robot],
        left_out=[estimate[robot] for estimate in left_out.values()],
        rivals=rivals,
    )
    if basis.torques:
        evidence = replace(evidence, bias=bias_of(equations, evidence))
    lower, upper = evidence.limits
    return Estimate(
        method=basis.method,
        names=names,
        values=values,
        covariance=covariance[robot, robot],
        lower=lower,
        upper=upper,
        left_out={key: estimate[robot] for key, estimate in left_out.items()},
        condition=conditioning.number,
        on_bound=tuple(compress(names, equations.on_bound[robot])),
        ending=ending_of(fit, evidence.half_widths),
        findings=(
            *conditioning.findings,
            *findings_of_bounds(equations, covariance, robot),
            *prior_contradictions(cells, covariance, about.known),
            *scale_errors(cells, carried, known),
            *few,
            *fit.findings,
            *basis.findings,
            *findings_of_scales(scales),
        ),
        fixed={name: value for name, value in fixed.items() if name not in names},
        agreement=contrasts,
        known=known,
        rivals=rivals,
        bias=evidence.bias,
        least=evidence.least,
        freedom=freedom[robot],
    )


def findings_of_scales(rivals: Iterable[ScaleRival]) -> list[Finding]:
    """Return for each term the scales that may be wrong instead."""
    of_terms: dict[str, list[ScaleRival]] = {}
    for rival in rivals:
        of_terms.setdefault(rival.term, []).append(rival)
    return [
        Finding(
            FindingKind.LIKE_SCALE,
            (term, *(rival.scale for rival in some)),
            number=max(abs(rival.share) for rival in some),
        )
        for term, some in of_terms.items()
    ]


def agreement_of(fit: Fit, basis: Basis) -> tuple[tuple[Contrast, ...], list[Rival]]:
    """Return the contrasts between conditions, the best first, and (n,) rivals about the fit.

    Contrasts from log to log are sought unless the logs are weighted by their scatter.
    """
    if basis.conditions is None:
        return (), []
    about = fit.unweighed or fit.linearisation
    contrasts, rivals = disagreements_of(
        about, basis.conditions, between_logs=not fit.scatters, large=basis.large
    )
    shift = fit.values - about.values
    return contrasts, [replace(rival, values=rival.values + shift) for rival in rivals]


def covariance_of(fit: Fit, basis: Basis, carried: Sequence[AddedMass]) -> Pair:
    """Return the (n, n) covariance of the values and its (n,) degrees of freedom.

    It is cluster-robust, with the uncertainty of the masses that cells carried and of the scales.
    """
    cells = fit.linearisation.independent
    considered = moved_by_givens(cells, carried, basis.known)
    covariance, freedom = cluster_covariance(*cells.stack, cells.prior, considered)
    if fit.bread is not None:
        rows, _ = cells.with_prior
        covariance = robust(covariance, rows.T @ rows, fit.bread)
    if basis.consider_covariance is not None:
        covariance = covariance + basis.consider_covariance
    return covariance, freedom


def without_each_mass(
    equations: Linearisation, basis: Basis
) -> tuple[Mapping[Hashable, Samples], list[Finding]]:
    """Return (n,) estimates from parts of the data, or the finding that there are too few.

    They are those without each added mass, to first order, if none are given.
    """
    if basis.left_out is not None:
        return basis.left_out, []
    masses, known, numbers = basis.masses, basis.known, np.unique(equations.log)
    different = sorted({masses[number] for number in numbers}) if masses else []
    left_out: dict[Hashable, Samples] = {}
    exact = known.within(known.fixed)
    for mass in different if len(different) > 1 else ():
        others = [other for other in different if other != mass]
        try:
            with_scale(others, exact, driven=basis.driven)
        except IdentifiabilityError:
            continue
        carrying = [number for number, carried in enumerate(masses) if carried == mass]
        values = without_logs(equations, carrying)
        if np.isfinite(values).all():
            left_out[mass] = values
    few = Finding(FindingKind.FEW_MASSES, number=len(different))
    return left_out, [] if not masses or left_out or known.scale(different[0]) else [few]


def bias_of(equations: Linearisation, evidence: Evidence) -> Samples:
    """(shared,) sizes of errors by a misfit, of the scale and of values that look precise; or 0."""
    values, half = evidence.values, evidence.half_widths
    misfit = misfit_over_value(equations.rows, equations.residuals, equations.values)[: values.size]
    pairs = zip(values.tolist(), half.tolist(), strict=True)
    looks = [CLEARLY * half <= _SURE * abs(value) for value, half in pairs]
    doubted = np.isin(equations.names[: values.size], OF_SCALE) | looks
    return np.where(doubted & (misfit > LOST), misfit * np.abs(values), 0.0)


def ending_of(fit: Fit, half: Samples) -> Ending:
    """Return how the fit ended: converged if its last step is small in (shared,) half-widths."""
    step = fit.unsettled
    if step is not None and (np.abs(step[: half.size]) <= _LAST_STEP * half).all():
        return Ending.CONVERGED
    return fit.ending


def findings_of_bounds(
    equations: Linearisation, covariance: Samples, robot: slice = slice(None)
) -> list[Finding]:
    """Return active bounds, first those that the data contradict, and unidentifiable signs."""
    names, active = equations.names[robot], equations.on_bound[robot]
    step = scaled_least_squares(*equations.independent.with_prior)
    beyond = (step > CLEARLY * np.sqrt(np.diag(covariance)))[robot]
    groups = (
        (FindingKind.PULLED, active & beyond),
        (FindingKind.ON_BOUND, active & ~beyond),
        (FindingKind.SIGN_UNKNOWN, [not TERMS[name].sign_observable for name in names]),
    )
    bounds = ((kind, tuple(compress(names, which))) for kind, which in groups)
    return [Finding(kind, some) for kind, some in bounds if some]


def with_held(fit: Fit, name: str, known: Prior, added: AddedMass) -> Fit:
    """Return a fit whose equations include a parameter that it held, and its prior.

    ``added``: what all logs carry. The parameter's column follows from the others, as residuals do
    not change with a common factor of all torques.
    """
    solved = fit.linearisation
    before = [*PARAMETERS, name]
    at = sum(other in solved.names for other in before[: before.index(name)])
    names = (*solved.names[:at], name, *solved.names[at:])
    grown = growth(names, np.insert(solved.values, at, known.fixed[name]), added)
    turned = np.insert(np.eye(len(solved.names)), at, -np.delete(grown, at) / grown[at], axis=1)

    def own_prior(equations: Linearisation) -> Penalty:
        values = np.insert(equations.values, at, known.fixed[name])
        about = dict(zip(names, values.tolist(), strict=True))
        penalty = Penalty.of(names, known.parameters, equations.realised_variance, about)
        assert penalty is not None  # noqa: S101 - what is held is uncertain
        return penalty

    def held(equations: Linearisation) -> Linearisation:
        """Return equations with the parameter among the values, which move only if others do."""
        values, penalty = np.insert(equations.values, at, known.fixed[name]), own_prior(equations)
        whole = replace(
            equations,
            names=names,
            values=values,
            rows=equations.rows @ turned,
            held=np.insert(equations.on_bound, at, [False]),
            lower=np.insert(equations.lower, at, TERMS[name].lower),
            prior=penalty.merged(equations.prior, at),
        )
        if penalty.active.sum() == 1:
            return whole
        moved = np.maximum(values - scaled_least_squares(*whole.with_prior), whole.lower)
        return replace(whole.moved(moved - values), values=moved)

    bread = fit.bread
    if bread is not None:
        of_logs = bread if solved.prior is None else bread - solved.prior.curvature
        bread = turned.T @ of_logs @ turned + own_prior(solved).curvature
    return replace(
        fit,
        linearisation=held(solved),
        unweighed=fit.unweighed and held(fit.unweighed),
        bread=bread,
        unsettled=None if fit.unsettled is None else np.insert(fit.unsettled, at, 0.0),
    )
