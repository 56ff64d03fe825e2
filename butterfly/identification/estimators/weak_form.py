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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import require_number
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.base import Estimator, names_of, require_usable
from butterfly.identification.estimators.instruments import refined, seen
from butterfly.identification.estimators.weak_fit import Windows
from butterfly.identification.estimators.weak_terms import WeakTerms
from butterfly.identification.estimators.zero_errors import zero_covariance
from butterfly.identification.inference.covariance import blocks_of, split
from butterfly.identification.inference.identifiability import is_driven, refuse_without_scale
from butterfly.identification.inference.intervals import of_few_logs, without_each_mass
from butterfly.identification.inference.term_choice import missing_terms
from butterfly.identification.reference import Reference
from butterfly.identification.weak_signals import HALF_WIDTH, Averaging
from butterfly.identification.zeros import doubts, reading_of
from butterfly.logs.log import Log
from butterfly.model.friction import require_periods
from butterfly.model.known import NOTHING, Knowledge
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.terms import FrictionTerms
from butterfly.verdict import Level

_APART = 0.05  # rad between rest angles, whose cosines then differ by a thousandth


@dataclass(frozen=True, kw_only=True)
class WeakForm(Estimator):
    """p1..p4, Coulomb torque, delay and terms by linear least squares, from any input.

    Of two different added masses at least (none counts as one), or of a robot of which enough is
    known. The covariance is the
    cluster-robust one over logs; the intervals are widened to hold the estimates that leave one
    added mass out, and those with other terms that predict as well. Stribeck velocity is scanned.

    Parameters
    ----------
    terms
        Fitted besides p1..p4, Coulomb torque and delay; if not given, those that help to predict
        logs that were left out.
    half_width
        Of the test functions in s; a sine's logs use at most a quarter period.
    cogging_periods
        Of a cogging torque in a turn, as known; the sine of one period is what p3 is.
    check
        Whether to fit again without each added mass.
    """

    method: Literal["weak-form"] = "weak-form"
    terms: tuple[str, ...] | None = None
    half_width: float = HALF_WIDTH
    cogging_periods: float = 1.0
    check: bool = True

    summary: ClassVar[str] = "linear fit against test functions, for any input"

    def __post_init__(self) -> None:
        names_of(self.method, self.terms or ())
        require_number(self.method, positive=True, unit="s", half_width=self.half_width)
        require_periods(self.method, self.cogging_periods)

    def __call__(self, data: DataSet) -> Estimate:
        """Estimate from all logs of a data set (see `Estimator`)."""
        zeros = data.equilibria
        uncertain = doubts(data.zeros) if data.hangs else None
        found = self.of_logs(data.logs, zeros, data.known, uncertain)
        guessed = data.guessed
        if guessed:
            care = Finding(kind=FindingKind.ZERO_GUESSED, logs=guessed, severity=Level.CARE)
            found = found.with_findings(care)
        if not data.unread:
            return found
        apart = max(zeros.values()) - min(zeros.values())
        if apart < _APART:
            return found
        care = Finding(kind=FindingKind.REST_APART, number=apart, severity=Level.CARE)
        return found.with_findings(care)

    def of_logs(
        self,
        logs: Sequence[Log],
        zeros: Mapping[AddedMass, float],
        known: Knowledge = NOTHING,
        uncertain: NDArray[np.float64] | None = None,
    ) -> Estimate:
        """Estimate from logs, given the encoder's zero in rad for each added mass.

        What a log tells of its own zero goes before it.

        Parameters
        ----------
        logs, zeros
            The logs, and the readings.
        known
            What is known of the robot.
        uncertain
            (k, n) standard uncertainties in rad of k independent errors of the zeros of the n logs.

        Raises
        ------
        IdentifiabilityError
            If the logs cannot determine the parameters.
        InputError
            If a log is shorter than a test function.
        """
        require_usable(self.method, known)
        masses, driven = [log.added_mass for log in logs], is_driven(logs)
        refuse_without_scale(masses, known, driven=driven)
        reference = Reference.of(masses, known, driven=driven)
        periods = known.exact.get("cogging_periods", self.cogging_periods)
        window = partial(self._windows, periods=periods)
        windows = [window(log, reading_of(log, zeros)) for log in logs]
        chosen = WeakTerms.of(windows, self.terms, reference.held, check=self.check)
        held = chosen.held | {"cogging_periods": periods}
        parameters = LumpedParameters(**held | chosen.fit.values)
        pairs = seen(logs, windows, parameters, zeros, window)
        fit = refined(chosen.fit, pairs)

        def without(mass: AddedMass) -> NDArray[np.float64]:
            rest = [each for each in pairs if each.windows.added != mass]
            return refined(chosen.fit, rest).solved.values

        left_out, few = without_each_mass(masses, without, known, asked=self.check, driven=driven)
        blocks = blocks_of(len(logs), len(fit.solved.names))
        solved = replace(fit.solved, cluster=split(fit.solved.cluster, blocks))
        rivals = [each + fit.solved.values - chosen.fit.solved.values for each in chosen.rivals]
        whole = reference.whole(solved)
        doubt = None if uncertain is None else zero_covariance(fit, pairs, uncertain, whole.names)
        found = Estimate.from_rows(
            whole,
            method="weak form",
            left_out=left_out,
            rivals=[reference.grown(each, solved.names) for each in rivals],
            findings=[*few, *of_few_logs(len(logs)), *chosen.said],
            held=held,
            masses=masses,
            blocks=blocks,
            known=known,
            besides=doubt,
        )
        return found.with_findings(*missing_terms(found, chosen.best))

    def _windows(self, log: Log, zero: float, *, periods: float) -> Windows:
        period = 2 * np.pi / log.excitation.omega if log.excitation else np.inf
        settings = FrictionTerms(cogging_periods=periods)
        half_width = min(self.half_width, period / 4)
        return Windows(log.added_mass, Averaging(log, zero, half_width, settings))
