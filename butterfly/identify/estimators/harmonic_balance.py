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

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from butterfly.errors import IdentifiabilityError
from butterfly.identify.estimate import ParameterEstimate
from butterfly.identify.estimators.base import Estimator, names_of
from butterfly.identify.estimators.describing_fit import DescribingFit
from butterfly.identify.estimators.describing_terms import DescribingTerms
from butterfly.identify.judgement.identifiability import refuse_one_mass
from butterfly.identify.judgement.intervals import without_each_mass
from butterfly.identify.phasors import Phasors
from butterfly.identify.simulated_response import simulated_fundamental
from butterfly.identify.steady import steady_sines

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from butterfly.identify.data import DataSet
    from butterfly.identify.judgement.findings import Finding
    from butterfly.model.parameters import AddedMass, LumpedParameters
    from butterfly.signals.frequency_response import ResponsePoint

    Motions = Callable[[LumpedParameters], NDArray[np.complex128]]

LINEAR = ("p1", "p2", "p3", "p4")
"""What is estimated in the limit of small swings without Coulomb friction and delay."""

_ROUNDS = 3  # of simulations, for the remainder
_SETTLED = 0.05  # of the errors, by which a last remainder may move the fit
_LIKE = 2.0  # largest ratio of measured and simulated swing of a log whose remainder is trusted


@dataclass(frozen=True, kw_only=True)
class HarmonicBalance(Estimator):
    """p1..p4, Coulomb torque, delay and terms from the steady responses of all sines.

    At least four logs, with at least two different added masses (none counts as one). The
    covariance is the cluster-robust one over logs; the intervals are widened to hold the estimates
    that leave one added mass out, and those with other terms that predict as well.

    Parameters
    ----------
    terms
        Fitted besides p1..p4, Coulomb torque and delay; those that help to predict logs that were
        left out if not given.
    check
        Whether to fit again without each added mass.
    """

    method: Literal["harmonic-balance"] = "harmonic-balance"
    terms: tuple[str, ...] | None = None
    check: bool = True

    summary: ClassVar[str] = "joint linear fit of the steady responses"

    def __post_init__(self) -> None:
        names_of(self.method, self.terms or ())

    def __call__(self, data: DataSet) -> ParameterEstimate:
        """Estimate from the sines of a data set (see `Estimator`)."""
        numbers, said = steady_sines(data)
        zeros = data.equilibria
        logs = [data.logs[k] for k in numbers]

        def motions(parameters: LumpedParameters) -> NDArray[np.complex128]:
            return np.array(
                [simulated_fundamental(log, parameters, zeros[log.added_mass]) for log in logs]
            )

        points = [point for k in numbers if (point := data.points[k]) is not None]
        return self._estimate(points, motions, said)

    def of_points(self, points: Sequence[ResponsePoint]) -> ParameterEstimate:
        """Estimate from steady responses, as far as describing functions go (see `Estimator`)."""
        return self._estimate(points, None, [])

    def _estimate(
        self, points: Sequence[ResponsePoint], motions: Motions | None, said: Sequence[Finding]
    ) -> ParameterEstimate:
        names = names_of(self.method, ())
        _refuse_too_few(points, names)
        phasors = Phasors.of(points, names, small=False)
        fit = DescribingFit.of(phasors)
        if motions is not None:
            fit = DescribingFit.of(_with_remainder(fit, motions))
        chosen = DescribingTerms.of(fit, self.terms)
        fit = DescribingFit.of(chosen.phasors)
        if motions is not None:
            fit = _settled(fit, motions)
        found = _judged(points, fit, "harmonic balance", said, chosen, check=self.check)
        return chosen.judge(found)


@dataclass(frozen=True, kw_only=True)
class Linear(Estimator):
    """p1..p4 of the linearisation from the steady responses of all sines.

    For swings so small that sin th = th, without Coulomb friction and delay: what is left of the
    harmonic balance is the joint linear complex fit -p1 w^2 G + j w p2 G + p3 G - p4 =
    (Z w^2 - X) G.

    Parameters
    ----------
    check
        Whether to fit again without each added mass.
    """

    method: Literal["linear"] = "linear"
    check: bool = True

    summary: ClassVar[str] = "joint complex fit for small swings without friction"

    def __call__(self, data: DataSet) -> ParameterEstimate:
        """Estimate from the sines of a data set (see `Estimator`)."""
        return self.of_points(data.sines)

    def of_points(self, points: Sequence[ResponsePoint]) -> ParameterEstimate:
        """Estimate from steady responses (see `Estimator`)."""
        _refuse_too_few(points, LINEAR)
        fit = DescribingFit.of(Phasors.of(points, LINEAR, small=True))
        return _judged(points, fit, "joint linear complex fit", [], None, check=self.check)


def _judged(
    points: Sequence[ResponsePoint],
    fit: DescribingFit,
    method: str,
    said: Sequence[Finding],
    chosen: DescribingTerms | None,
    *,
    check: bool,
) -> ParameterEstimate:
    masses = [point.added_mass for point in points]

    def without(mass: AddedMass) -> NDArray[np.float64]:
        kept = np.array([each != mass for each in masses])
        _refuse_too_few([point for point in points if point.added_mass != mass], fit.phasors.names)
        return DescribingFit.of(fit.phasors.take(kept)).solved.values

    left_out, few = without_each_mass(masses, without, asked=check)
    return ParameterEstimate.from_rows(
        fit.solved,
        method=method,
        left_out=left_out,
        rivals=chosen.rivals if chosen else (),
        findings=[*few, *said],
        held=chosen.held if chosen else None,
    )


def _settled(fit: DescribingFit, motions: Motions) -> DescribingFit:
    """Take the remainder anew until it moves the fit no more."""
    for _ in range(_ROUNDS - 1):
        before, fit = fit, DescribingFit.of(_with_remainder(fit, motions))
        if fit.moved_to(before) < _SETTLED:
            break
    return fit


def _with_remainder(fit: DescribingFit, motions: Motions) -> Phasors:
    """Return the balance with what the model's own motion leaves over in it.

    None where the model, or its motion in a log, is too far from the robot's to tell.
    """
    phasors, parameters = fit.phasors, fit.parameters
    if not parameters.p1 + min(mass.inertia for mass in phasors.masses) > 0:
        return phasors
    moved = motions(parameters)
    size = np.abs(moved) / np.abs(phasors.angle)
    told = np.isfinite(size) & (size > 1 / _LIKE) & (size < _LIKE)
    return phasors.corrected(parameters, np.where(told, moved, phasors.angle), told)


def _refuse_too_few(points: Sequence[ResponsePoint], names: Sequence[str]) -> None:
    if not points:
        raise IdentifiabilityError(
            "no log says that its input was a sine: give omega and amplitude in the manifest; the "
            "methods weak-form and output-error take any input"
        )
    refuse_one_mass(point.added_mass for point in points)
    if 2 * len(points) <= len(names):
        raise IdentifiabilityError(
            f"{len(points)} logs give {2 * len(points)} equations for {len(names)} "
            "parameters: add runs at other frequencies"
        )
