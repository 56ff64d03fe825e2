"""Parameters that somebody gives, in the place of an identification."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import ButterflyError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Ending, Finding, FindingKind
from butterfly.identification.diagnostics.goodness_of_fit import judge_fit
from butterfly.identification.diagnostics.physics import is_possible, judge_physics
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators.weak_form import WeakForm
from butterfly.identification.other_parameters import best_gain, told_parameters
from butterfly.model.known import Knowledge, Known
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.model.terms import PARAMETERS
from butterfly.verdict import Level

METHOD = "given parameters"

_FAR_MORE = 3.0  # times the misfit of values that the logs give themselves
_NOTABLE = 10.0  # per cent of misfit below which logs are followed well by any measure
_OF_FITS = {FindingKind.POOR_FIT, FindingKind.UNFOLLOWED, FindingKind.UNFORETOLD}


def given_estimate(
    told: Mapping[str, object],
    source: str,
    *,
    data: DataSet | None = None,
    masses: Sequence[AddedMass] = (),
) -> Estimate:
    """Return given parameters as an estimate of which no uncertainty is known.

    Parameters
    ----------
    told
        p1 and p3, and whatever else is not 0 and not known of the data; ``zero`` is the encoder's
        reading in rad where the model's angle is 0. Without p4 the one with the best FIT is taken.
    source
        For messages.
    data
        The logs that they are to foretell, if somebody recorded them.
    masses
        What the joint will carry.

    Raises
    ------
    InputError
        Naming the part that is wrong, or p4, where no log tells the best one.
    """
    values = ({} if data is None else data.known.exact) | dict(told)
    zero = values.pop("zero", None)
    parameters = told_parameters(values, source)
    local: dict[AddedMass | str | None, dict[str, float]] = {}
    if zero is not None:
        local[None] = {"zero": _angle(zero, source)}
        data = data and data.with_zero(Known(value=local[None]["zero"]))
    if math.isnan(parameters.p4):
        if data is None:
            raise InputError(source, "p4", "nothing", "a value")
        parameters = replace(parameters, p4=best_gain(parameters, data, source=source))
    found = asdict(parameters)
    count = len(PARAMETERS)
    unknown = np.full(count, np.nan)
    estimate = Estimate(
        method=METHOD,
        names=PARAMETERS,
        values=np.array([found[name] for name in PARAMETERS]),
        covariance=np.full((count, count), np.nan),
        lower=unknown,
        upper=unknown,
        left_out={},
        condition=math.nan,
        on_bound=(),
        ending=Ending.CONVERGED,
        findings=(),
        held={name: value for name, value in found.items() if name not in PARAMETERS},
        local=local,
        input_kind=None if data is None else data.input_kind,
        joint=JointKind.HINGE if data is None else data.joint,
    )
    return estimate.with_findings(*judge_physics(estimate, masses))


def judged_on(estimate: Estimate, fits: NDArray[np.float64], names: Sequence[str]) -> Estimate:
    """Return an estimate judged by how well it foretells logs, not by those it was made from.

    Parameters
    ----------
    estimate
        Of the parameters.
    fits
        (n,) FIT of each log in per cent.
    names
        Of the n logs.
    """
    rest = tuple(each for each in estimate.findings if each.kind not in _OF_FITS)
    return replace(estimate, findings=(*rest, *judge_fit(fits, names)))


def outdone(
    data: DataSet, estimate: Estimate, fits: NDArray[np.float64], numbers: Sequence[int]
) -> list[Finding]:
    """Tell whether values that the logs give themselves follow them far better.

    With the same p4, by the weak form, over the same stretches: an angle that is put back on its
    way every second is followed well by many.

    Parameters
    ----------
    data, estimate
        The logs and the parameters.
    fits
        (n,) FIT in per cent with them.
    numbers
        Of the n logs.
    """
    known = Knowledge(parameters={"p4": Known(value=estimate.parameters.p4)})
    try:
        own = WeakForm(check=False)(replace(data.take(numbers), known=known))
    except ButterflyError:
        return []
    if not is_possible(own, data.masses):
        return []
    own = replace(own, horizon=data.simulations.horizon(estimate))
    reached = float(np.median(data.simulations.fits(own, numbers)))
    left, given = 100 - reached, 100 - float(np.median(fits))
    if given <= max(_FAR_MORE * left, _NOTABLE):
        return []
    return [Finding(kind=FindingKind.OUTDONE, number=reached, severity=Level.CARE)]


def _angle(value: object, source: str) -> float:
    try:
        return float(value)  # type: ignore[arg-type]  # what is none is refused
    except (TypeError, ValueError):
        raise InputError(source, "zero", value, "an angle in rad") from None
