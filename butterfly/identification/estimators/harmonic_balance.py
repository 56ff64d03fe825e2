"""The default method: a linear regression over all logs, at their own finite amplitudes.

At each log's frequency w, with the phasors th of the angle and u of the input and a = |th|, the
balance of the fundamental of (78) with Coulomb friction and an input delay d reads

    [-(p1 + Z) w^2 + j w p2 + (p3 + X) 2 J1(a)/a + j 4 T_c/(pi a)] th = p4 e^(-j w d) u + r

which is linear in p1, p2, p3, T_c, p4 and, to first order about the current delay, in p4 d; so are
the describing functions of all other terms that it offers. The
known Z = m l^2 and X = m g l set the scale, so two different added masses are needed. Each row is
divided by the slope of its left-hand side in th at the previous iterate (Sanathanan & Koerner,
IEEE Trans. Autom. Control 8, 1963), which turns equation errors into angle errors, and by the
angle error's standard deviation: the measured one of the phasor, and one in proportion to the
swing, common to all logs, that makes room for what the model leaves out (Paule & Mandel, J. Res.
NBS 87, 1982).

The remainder r is what the free run of the model itself leaves over in that balance, read in the
same window: what describing functions neglect, a transient that still rings, stamps that are not
regular. It is 0 at first; with it the fit ends where the model's steady response is the measured
one (indirect inference; Gourieroux, Monfort & Renault, J. Appl. Econometrics 8, 1993).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from butterfly.errors import IdentifiabilityError
from butterfly.identification.blocks import Conditions
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.base import Estimator, require_names, require_usable
from butterfly.identification.estimators.harmonic_balance_regression import (
    HarmonicBalanceFit,
    Phasors,
)
from butterfly.identification.estimators.steady_response import (
    RestAngles,
    SteadyModel,
    steady_sines,
)
from butterfly.identification.inference.agreement import contrasts_of
from butterfly.identification.inference.identifiability import ScaleParameter, refuse_without_scale
from butterfly.identification.inference.infer import infer
from butterfly.identification.inference.submodels import Submodels
from butterfly.identification.inference.term_choice import (
    BASE,
    CANDIDATES,
    RARER,
    TermChoice,
    candidates,
    requested_terms,
    scanned_terms,
)
from butterfly.identification.levels import FEW
from butterfly.identification.simulation import Simulation
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.prior import NO_PRIOR, Prior
from butterfly.model.terms import PARAMETERS, offered
from butterfly.signals.frequency_response import ResponsePoint

_OF_REST = "bias"

LINEAR = ("p1", "p2", "p3", "p4")
"""What is estimated in the limit of small swings without Coulomb friction and delay."""
_NAME = "harmonic balance"


@dataclass(frozen=True, kw_only=True)
class HarmonicBalance(Estimator):
    """Estimate p1..p4, coulomb, delay and terms from the steady responses to sines.

    Needs at least four logs with two different added masses (none counts as one), or enough known
    values. The covariance is cluster-robust over logs; the intervals are widened to include the
    leave-one-mass-out estimates, and those with other terms that predict as well. The Stribeck
    velocity comes from a grid search.

    Parameters
    ----------
    terms
        Terms fitted besides p1..p4, coulomb and delay; if not given, those that improve the
        prediction of held-out logs.
    """

    method: Literal["harmonic-balance"] = "harmonic-balance"
    terms: tuple[str, ...] | None = None

    summary: ClassVar[str] = "linear fit of the steady responses to sines"

    def __post_init__(self) -> None:
        require_names(self.method, "terms", self.terms or (), offered(self.method))

    def __call__(self, data: DataSet) -> Estimate:
        """Estimate from the sines of a data set (see `Estimator`)."""
        data.require_angles(self.method)
        require_usable(self.method, data.known)
        numbers, said = steady_sines(data)
        points = [point for k in numbers if (point := data.points[k]) is not None]
        _refuse_unsteady(len(data.sines), len(points), len(data.known.fitted(PARAMETERS)))
        reference, fit = _begun(points, data.known, PARAMETERS)
        wanted = None if self.terms is None else "bias" in self.terms
        told = [data.logs[k].zero for k in numbers]
        rest = RestAngles.of(points, fit.parameters, data.equilibria, asked=wanted, told=told)
        logs = [Simulation(data.logs[k], fit.parameters) for k in numbers]
        poles = [point.pole for point in points]
        robot = SteadyModel(simulations=logs, rest=rest, poles=poles)
        if BASE in (self.terms or ()):
            fit = fit.on_likeliest_base(requested_terms(self.terms or (), {_OF_REST}))
        fit, robot = robot.settled(fit)
        conditions = Conditions.of([data.logs[k] for k in numbers], cells=1, steady=True)
        always, optional = fit.phasors.names, self._optional
        chosen, fit, robot = self._searched(fit, robot, conditions, optional)
        if self._may_move(chosen, fit, conditions):
            based = fit.on_likeliest_base(optional).phasors
            begun = HarmonicBalanceFit.of(replace(based, names=always))
            optional = (*optional, BASE)
            if BASE in self._chosen(begun, conditions, optional)[0].terms:
                moving = self._searched(begun, robot, conditions, optional)
                nearer = BASE in moving[0].terms and moving[1].misfit < fit.misfit
                if nearer and _bears(moving[1].parameters, data.masses):
                    chosen, fit, robot = moving
        known = robot.rest if robot.rest.bias is not None else None
        return _judged(
            points, fit, _NAME, said, reference, chosen=chosen, rest=known, conditions=conditions
        )

    def _searched(
        self,
        fit: HarmonicBalanceFit,
        robot: SteadyModel,
        conditions: Conditions,
        optional: Sequence[str],
    ) -> tuple[TermChoice, HarmonicBalanceFit, SteadyModel]:
        """Choose terms, and those rarer ones without which parameters follow conditions."""
        always = fit.phasors.names
        plain: tuple[TermChoice, HarmonicBalanceFit, SteadyModel] | None = None
        again = False
        while True:
            chosen, fit = self._chosen(fit, conditions, optional)
            fit, robot = robot.settled(fit)
            while self.terms is None and (idle := fit.idle):
                chosen = chosen.without(idle)
                fit = HarmonicBalanceFit.of(replace(fit.phasors, names=chosen.names))
            for _ in range(FEW if BASE in fit.phasors.names else 0):
                fit = HarmonicBalanceFit.of(fit.on_likeliest_base().phasors)
                fit, robot = robot.settled(fit)
            lacking = fit.lacking(always, conditions) if self.terms is None else None
            if lacking is not None:
                plain, always = plain or (chosen, fit, robot), (*always, lacking)
            elif again or plain is None:
                break
            else:  # the others were chosen by a motion that lacked it
                again = True
            fit = HarmonicBalanceFit.of(replace(fit.phasors, names=always))
        if plain and contrasts_of(fit.solved, conditions):  # it is no such term
            return plain
        return chosen, fit, robot

    def of_points(self, points: Sequence[ResponsePoint], known: Prior = NO_PRIOR) -> Estimate:
        """Estimate from steady responses, as far as describing functions go (see `Estimator`)."""
        reference, first = _begun(points, known, PARAMETERS)
        chosen, fit = self._chosen(first, None, self._optional)
        return _judged(points, fit, _NAME, [], reference, chosen=chosen)

    @property
    def _optional(self) -> tuple[str, ...]:
        """Terms that are tried where none are told."""
        able = {*offered(self.method)} - {_OF_REST}  # which the middles of the swings tell
        return tuple(name for name in CANDIDATES if name in able)

    def _may_move(
        self, chosen: TermChoice, fit: HarmonicBalanceFit, conditions: Conditions
    ) -> bool:
        """Whether to try a base that gives: parameters follow what they should not."""
        if self.terms is not None or not candidates((BASE,), fit.phasors.masses, fit.phasors.known):
            return False
        return not {*RARER}.isdisjoint(chosen.names) or bool(contrasts_of(fit.solved, conditions))

    def _chosen(
        self, fit: HarmonicBalanceFit, conditions: Conditions | None, optional: Sequence[str]
    ) -> tuple[TermChoice, HarmonicBalanceFit]:
        """Choose from all terms, or only the Stribeck velocity of those asked for; fit them."""
        phasors = fit.phasors

        def with_terms(terms: tuple[str, ...], speed: float | None) -> Submodels:
            slow = phasors.stribeck_velocity if speed is None else speed
            names = (*phasors.names, *terms)
            nested = fit.nested(replace(phasors, names=names, stribeck_velocity=slow))
            return replace(nested, conditions=conditions)

        chosen = scanned_terms(
            with_terms,
            phasors.names,
            None if self.terms is None else requested_terms(self.terms, {_OF_REST}),
            optional,
            masses=phasors.masses,
            known=phasors.known,
            fastest=float(np.max(np.abs(phasors.angle) * phasors.omega)),
        )
        slow = chosen.settings.get("stribeck_velocity", phasors.stribeck_velocity)
        with_them = replace(phasors, names=chosen.names, stribeck_velocity=slow)
        return chosen, HarmonicBalanceFit.of(with_them)


@dataclass(frozen=True, kw_only=True)
class Linear(Estimator):
    """Estimate p1..p4 of the linearisation from the steady responses to sines.

    For small swings (sin th = th) without Coulomb friction and delay, harmonic balance reduces to
    the linear complex fit -p1 w^2 G + j w p2 G + p3 G - p4 = (Z w^2 - X) G.
    """

    method: Literal["linear"] = "linear"

    summary: ClassVar[str] = "linear fit of the steady responses, small swings without friction"

    def __call__(self, data: DataSet) -> Estimate:
        """Estimate from the sines of a data set (see `Estimator`)."""
        data.require_angles(self.method)
        return self.of_points(data.sines, data.known)

    def of_points(self, points: Sequence[ResponsePoint], known: Prior = NO_PRIOR) -> Estimate:
        """Estimate from steady responses (see `Estimator`)."""
        require_usable(HarmonicBalance.method, known, LINEAR)
        reference, fit = _begun(points, known, LINEAR, small=True)
        return _judged(points, fit, "joint linear complex fit", [], reference)


def _begun(
    points: Sequence[ResponsePoint], known: Prior, names: tuple[str, ...], *, small: bool = False
) -> tuple[ScaleParameter, HarmonicBalanceFit]:
    """Fit some parameters, and say on what their scale rests."""
    _refuse_too_few(points, known.fitted(names), known)
    reference = ScaleParameter.of([point.added_mass for point in points], known)
    known = reference.fixed
    phasors = Phasors.of(points, known.fitted(names), small=small, known=known)
    return reference, HarmonicBalanceFit.of(phasors)


def _bears(p: LumpedParameters, masses: Iterable[AddedMass]) -> bool:
    """Tell whether a base is at least as heavy as what swings on it, whose least mass is h^2/p1."""
    for loaded in map(p.with_added_mass, masses):
        least = (loaded.moments[0] ** 2 + loaded.moments[1] ** 2) / loaded.p1
        if 2 * least * loaded.base_compliance * loaded.base_frequency**2 > 1:
            return False
    return True


def _judged(
    points: Sequence[ResponsePoint],
    fit: HarmonicBalanceFit,
    method: str,
    said: Sequence[Finding],
    reference: ScaleParameter,
    *,
    chosen: TermChoice | None = None,
    rest: RestAngles | None = None,
    conditions: Conditions | None = None,
) -> Estimate:
    """Judge a fit, and the bias that the rest angles tell."""
    if chosen and BASE in fit.phasors.names:
        chosen = replace(chosen, settings=chosen.settings | fit.phasors.base)
    solved = fit.solved if rest is None else fit.solved.beside(rest.solved)
    more = solved.values[fit.solved.values.size :]
    others = chosen.rival_values if chosen else ()
    if BASE in fit.phasors.names:
        others = (*others, *fit.on_other_bases)
    rivals = (np.append(each, more) for each in others)
    whole = reference.whole(solved)
    besides = np.zeros((len(whole.names), len(whole.names)))
    if rest is not None:
        besides[-1, -1] = rest.variance_by_zeros
    found = infer(
        whole,
        method=method,
        rivals=tuple(reference.grown(each, solved.names) for each in rivals),
        findings=said,
        fixed=chosen.settings if chosen else None,
        masses=[point.added_mass for point in points],
        conditions=conditions,
        known=reference.known,
        local=None if rest is None else rest.shared_zero,
        besides=besides,
    )
    return found if chosen is None else found.with_findings(*chosen.findings)


def _refuse_unsteady(sines: int, steady: int, sought: int) -> None:
    if steady < sines and 2 * steady <= sought:
        raise IdentifiabilityError(
            f"only {steady} of {sines} sine logs show a steady swing about a rest angle: in the "
            "others the joint turns over, rests elsewhere, swings too wide or does not settle; use "
            "weak-form or output-error, which accept any motion"
        )


def _refuse_too_few(points: Sequence[ResponsePoint], names: Sequence[str], known: Prior) -> None:
    if not points:
        raise IdentifiabilityError(
            "no log is marked as a sine: set omega and amplitude in the manifest, or use weak-form "
            "or output-error, which accept any input"
        )
    refuse_without_scale((point.added_mass for point in points), known)
    if 2 * len(points) <= len(names):
        give = "log gives" if len(points) == 1 else "logs give"
        raise IdentifiabilityError(
            f"{len(points)} {give} {2 * len(points)} equations for {len(names)} parameters: add "
            "runs at other frequencies"
        )
