"""Identifiability by conditioning; and fits whose scale rests on one uncertain known value.

Where all logs carry the same, the equations are homogeneous: p1..p4 with the carried inertia and
moment fit as well times any factor. Noise in the regressors would bias least squares towards small
factors. So the known value that determines the scale best is held in the fit, and given its
uncertainty after it: its column follows from homogeneity.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples, unit_columns
from butterfly.errors import IdentifiabilityError
from butterfly.identification.findings import Finding, FindingKind
from butterfly.identification.fit import Fit
from butterfly.identification.levels import ROUNDING
from butterfly.identification.linearisation import Linearisation, scaled_least_squares
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.model.prior import Penalty, Prior
from butterfly.model.terms import PARAMETERS, SHARES, TERMS

SINGULAR_CONDITION = 1 / ROUNDING
"""Above this condition number, a scaled regression is singular for every practical purpose."""

WEAK_CONDITION = SINGULAR_CONDITION**0.5
"""Above this one, half as many digits, one combination is poorly determined."""

OTHER_LOGS = "add logs at other speeds and amplitudes, or with another known mass"
"""Advice where logs have too little information."""


@dataclass(frozen=True)
class Conditioning:
    """Conditioning of a regression, whatever the units of its parameters."""

    number: float  # condition number with the columns scaled to one length
    weakest: tuple[str, ...]  # parameters of the combination that is determined worst
    sum: str = ""  # of two such, the sentence on the combination that is determined

    @classmethod
    def of(
        cls,
        rows: Samples,
        names: tuple[str, ...],
        known: NDArray[np.bool_] | None = None,
        about: tuple[Samples, Samples] | None = None,
    ) -> Conditioning:
        """Return that of (m, n) rows; ``known``: (n,) mask of parameters with a prior."""
        # ``about``: values and residuals, to compute the combination of two parameters
        scaled, size = unit_columns(rows)  # one without effect makes the regression singular
        whole = scaled if known is None else np.concatenate([scaled, np.eye(len(names))[known]])
        _, singular, right = np.linalg.svd(whole, full_matrices=False)
        # those of more than an equal share of the direction
        largest = np.flatnonzero(right[-1] ** 2 > 1 / (1 + len(names)))
        number = float(singular[0] / singular[-1]) if singular[-1] > 0 else math.inf
        found = cls(number=number, weakest=tuple(names[k] for k in largest))
        ours = largest.size == 2 and {*found.weakest} <= TERMS.keys()  # noqa: PLR2004 - a sum
        if about is None or not ours:
            return found
        values = about[0] - np.linalg.lstsq(scaled, about[1], rcond=1 / WEAK_CONDITION)[0] / size
        (first, second), (one, other) = found.weakest, right[-1][largest] / size[largest]
        share = float(-one / other)
        both = float(values[largest[0]] + share * values[largest[1]])
        text = f"{first} {'+' if share > 0 else '-'} {abs(share):.3g} {second} is {both:.4g}"
        most = f", {first} at most that" if share > 0 and not TERMS[second].lower < 0 else ""
        return replace(found, sum=f"{text}{most}")

    @property
    def singular(self) -> bool:
        """Whether it is singular for every practical purpose."""
        return self.number > SINGULAR_CONDITION

    @property
    def refusal(self) -> IdentifiabilityError:
        """The error that names the parameters that are not identifiable."""
        alone = " separately" if len(self.weakest) > 1 else ""
        but = f", but {self.sum}" if self.sum else ""
        return IdentifiabilityError(
            f"{' and '.join(self.weakest)} cannot be identified{alone} from these logs (condition "
            f"number {self.number:.1e}){but}: {OTHER_LOGS}"
        )

    @property
    def findings(self) -> list[Finding]:
        """The finding of a poorly determined combination, if any."""
        if self.number <= WEAK_CONDITION:
            return []
        return [Finding(FindingKind.COMBINATION, self.weakest, number=self.number)]


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
    if not driven and not {"p4", "delay"} <= known.fixed.keys():
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


def with_held(fit: Fit, name: str, known: Prior, added: AddedMass) -> Fit:
    """Return a fit whose equations include a parameter that it held, and its prior.

    ``added``: what all logs carry. The parameter's column follows from the others, as residuals do
    not change with a common factor of all torques.
    """
    solved = fit.linearisation
    before = [*PARAMETERS, name]
    at = sum(each in solved.names for each in before[: before.index(name)])
    names = (*solved.names[:at], name, *solved.names[at:])
    grown = growth(names, np.insert(solved.values, at, known.fixed[name]), added)
    turned = np.insert(np.eye(len(solved.names)), at, -np.delete(grown, at) / grown[at], axis=1)

    def own_prior(equations: Linearisation) -> Penalty:
        values = np.insert(equations.values, at, known.fixed[name])
        about = dict(zip(names, values.tolist(), strict=True))
        own = Penalty.of(names, known.parameters, equations.realised_variance, about)
        assert own is not None  # noqa: S101 - what is held is uncertain
        return own

    def held(equations: Linearisation) -> Linearisation:
        """Return equations with the parameter among the values, which move only if others do."""
        values, own = np.insert(equations.values, at, known.fixed[name]), own_prior(equations)
        whole = replace(
            equations,
            names=names,
            values=values,
            rows=equations.rows @ turned,
            held=np.insert(equations.on_bound, at, [False]),
            lower=np.insert(equations.lower, at, TERMS[name].lower),
            prior=own.beside(equations.prior, at),
        )
        if own.active.sum() == 1:
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
