"""What an estimator returns: values with covariance, intervals, and what can be concluded."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.diagnostics.findings import Ending, Finding, FindingKind, grade
from butterfly.identification.diagnostics.knowledge import (
    disagreements,
    moved_by_masses,
    scale_apart,
)
from butterfly.identification.inference.covariance import cluster_covariance, robust
from butterfly.identification.inference.identifiability import Conditioning, sort_by_precision
from butterfly.identification.inference.intervals import honest_limits
from butterfly.identification.inference.mass_consistency import Correction, corrections
from butterfly.identification.normal_equations import SolvedEquations, pulled_below
from butterfly.logs.log import Log
from butterfly.model.known import NOTHING, Knowledge
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.terms import TERMS
from butterfly.verdict import Level


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """Parameters of the bare hand and how far to trust them.

    Parameters
    ----------
    method
        How they were obtained.
    names
        The n parameters estimated: `butterfly.model.terms.PARAMETERS`, then terms.
    values
        (n,) in their order.
    covariance
        (n, n); NaN where the method has no statement to make.
    lower, upper
        (n,) limits of the intervals at `butterfly.identification.intervals.CONFIDENCE`.
    held
        Parameters that were held at values other than the model's defaults.
    left_out
        (n,) estimates with the logs of one added mass (or one run) left out; empty if there are
        too few.
    condition
        Condition number of the column-scaled regression (or Jacobian).
    on_bound
        Parameters held by a bound.
    ending
        How the estimation ended.
    findings
        What can and cannot be concluded.
    resonances
        Where the method rests on resonance frequencies: these, in rad/s, per added mass.
    local
        Where the method estimates them: ``zero`` (the encoder's reading in rad at the model's
        angle 0), ``velocity`` (at the first sample, in rad/s) and ``bias``, for one log (by its
        name), for one added mass, or for all (None).
    corrections
        What added masses would have to be for the logs to agree better, the best explained first;
        none where that was not asked.
    rivals
        (n,) estimates of fits with other terms that predict as well, which the intervals hold too.
    horizon
        Longest stretch in s over which logs are simulated with it; infinite where whole logs were
        asked for, None where it is left to the logs (see `butterfly.identification.divergence`).
    known
        What was known of the robot before; what is known exactly is among ``held``.
    freedom
        (n,) degrees of freedom of the standard errors; None where they are not known.
    """

    method: str
    names: tuple[str, ...]
    values: NDArray[np.float64]
    covariance: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    left_out: Mapping[Hashable, NDArray[np.float64]]
    condition: float
    on_bound: tuple[str, ...]
    ending: Ending
    findings: tuple[Finding, ...]
    held: dict[str, float] = field(default_factory=dict)
    resonances: dict[AddedMass, float] = field(default_factory=dict)
    local: dict[AddedMass | str | None, dict[str, float]] = field(default_factory=dict)
    corrections: tuple[Correction, ...] = ()
    rivals: tuple[NDArray[np.float64], ...] = ()
    horizon: float | None = None
    known: Knowledge = NOTHING
    freedom: NDArray[np.float64] | None = None

    @classmethod
    def from_rows(
        cls,
        solved: SolvedEquations,
        *,
        method: str,
        left_out: Mapping[Hashable, NDArray[np.float64]],
        rivals: Sequence[NDArray[np.float64]] = (),
        shared: int | None = None,
        findings: Sequence[Finding] = (),
        held: dict[str, float] | None = None,
        local: dict[AddedMass | str | None, dict[str, float]] | None = None,
        masses: Sequence[AddedMass] = (),
        horizon: float | None = None,
        blocks: int = 1,
        known: Knowledge = NOTHING,
        besides: NDArray[np.float64] | None = None,
    ) -> Estimate:
        """Judge a solver's end: conditioning, covariance, intervals, bounds, findings.

        Parameters
        ----------
        solved
            The values and their equations.
        method
            How they were obtained.
        left_out
            (n,) values from parts of the data, which widen the intervals.
        rivals
            (n,) values of other fits that predict as well, which widen them too.
        shared
            How many values, from the first on, are parameters of the robot; all if not given.
        findings, held, local, horizon
            As the estimate has them; the findings come after those on the values.
        masses
            What each log carried, where the clusters are logs, or blocks of them.
        blocks
            Clusters of each log.
        known
            What was known of the robot.
        besides
            (n, n) covariance of what was taken as given, to be added to that of the equations.

        Raises
        ------
        IdentifiabilityError
            If the equations are singular for every practical purpose.
        """
        rows, residuals = solved.by_cluster()
        whole, left = solved.with_prior(rows, residuals)
        told = None if solved.prior is None else solved.prior.told
        conditioning = Conditioning.of(rows.reshape(-1, len(solved.names)), solved.names, told)
        conditioning.refuse_singular()
        numbers = np.unique(solved.cluster).tolist() if masses else []
        carried = {number: masses[number // blocks] for number in numbers}
        considered = moved_by_masses(rows, solved.names, carried)
        covariance, freedom = cluster_covariance(rows, residuals, solved.prior, considered)
        if solved.bread is not None:
            covariance = robust(covariance, whole.T @ whole, solved.bread)
        if besides is not None:
            covariance = covariance + besides
        apart = [
            *disagreements(solved.prior, solved.names, solved.values, covariance, whole),
            *scale_apart(solved, rows, residuals, known, carried),
        ]
        own = slice(shared)
        names, values = solved.names[own], solved.values[own]
        scatter = covariance[own, own]
        limits = honest_limits(values, scatter, freedom[own], left_out.values(), rivals)
        lower = np.maximum(limits[0], solved.lower[own])
        on_bound = tuple(np.array(names)[solved.on_bound[own]].tolist())
        pulled = set(np.array(names)[pulled_below(whole, left, covariance)[own]].tolist())
        return cls(
            method=method,
            names=names,
            values=values,
            covariance=scatter,
            lower=lower,
            upper=limits[1],
            left_out=left_out,
            condition=conditioning.number,
            on_bound=on_bound,
            ending=solved.ending,
            findings=(
                *sort_by_precision(values, lower, limits[1], names),
                *conditioning.findings,
                *solved.findings,
                *_of_bounds(on_bound, pulled),
                *_of_signs(names),
                *apart,
                *findings,
            ),
            held=known.exact | (held or {}),
            local=local or {},
            corrections=corrections(rows, residuals, solved.names, carried if blocks == 1 else {}),
            known=known,
            rivals=tuple(rivals),
            horizon=horizon,
            freedom=freedom[own],
        )

    @property
    def parameters(self) -> LumpedParameters:
        """The estimate as parameters of the model."""
        found = dict(zip(self.names, self.values.tolist(), strict=True))
        return LumpedParameters(**self.held | found)

    @property
    def unestimated(self) -> frozenset[str]:
        """Parameters to which the method gives a value without estimating it."""
        told = [each for each in self.findings if each.kind is FindingKind.NOT_ESTIMATED]
        return frozenset(name for each in told for name in each.parameters)

    @property
    def level(self) -> Level:
        """How much speaks against the values."""
        return grade(self.ending, self.findings)[0]

    @property
    def reasons(self) -> tuple[Finding, ...]:
        """The findings for which the verdict is no better."""
        return grade(self.ending, self.findings)[1]

    @property
    def standard_errors(self) -> NDArray[np.float64]:
        """(n,) square roots of the variances."""
        return np.sqrt(np.diag(self.covariance))

    def applied(self, log: Log) -> tuple[LumpedParameters, dict[str, float]]:
        """Return what holds for one log: parameters, and zero and velocity where known."""
        own: dict[str, float] = {}
        for key in (None, log.added_mass, log.name):
            own |= self.local.get(key, {})
        if log.zero is not None and log.zero.exact:
            own["zero"] = log.zero.value
        parameters = self.parameters
        return replace(parameters, bias=own.pop("bias", parameters.bias)), own

    def owners(self, masses: Iterable[AddedMass]) -> list[tuple[str, AddedMass | str | None]]:
        """Return whose each encoder's zero and bias is (see `local`).

        Where no zero was fitted, one belongs to each of ``masses``.
        """
        owners = [
            (name, whose)
            for whose, values in self.local.items()
            for name in values
            if name != "velocity"
        ]
        if not any(name == "zero" for name, _ in owners):
            owners += [("zero", mass) for mass in masses]
        return owners

    def with_gain(self, p4: float) -> Estimate:
        """Return the estimate with p4 set to a value found otherwise."""
        values = np.where(np.array(self.names) == "p4", p4, self.values)
        return replace(self, values=values)

    def with_findings(self, *more: Finding) -> Estimate:
        """Return the estimate with further findings."""
        return replace(self, findings=(*self.findings, *more))

    def with_slips(self, *slips: Finding) -> Estimate:
        """Return the estimate with the slips that explain it said first, and no guess at others."""
        if not slips:
            return self
        rest = (each for each in self.findings if each.kind is not FindingKind.TORQUE_DRIVEN)
        return replace(self, findings=(*slips, *rest))


def _of_bounds(on_bound: tuple[str, ...], pulled: set[str]) -> list[Finding]:
    """Say what a bound holds; it needs care only where the data would go far beyond."""
    groups = {
        Level.CARE: tuple(name for name in on_bound if name in pulled),
        Level.NOTE: tuple(name for name in on_bound if name not in pulled),
    }
    return [
        Finding(kind=FindingKind.ON_BOUND, parameters=names, severity=severity)
        for severity, names in groups.items()
        if names
    ]


def _of_signs(names: Sequence[str]) -> list[Finding]:
    unknown = tuple(name for name in names if not TERMS[name].sign_observable)
    if not unknown:
        return []
    return [Finding(kind=FindingKind.SIGN_UNKNOWN, parameters=unknown, severity=Level.CARE)]
