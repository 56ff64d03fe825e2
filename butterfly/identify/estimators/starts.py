"""Where iterations start: closed forms' parameters, and rest angles of the encoder."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from butterfly.errors import ButterflyError
from butterfly.identify.estimators.harmonic_balance import HarmonicBalance
from butterfly.identify.estimators.weak_form import WeakForm

if TYPE_CHECKING:
    from collections.abc import Mapping

    from butterfly.identify.data import DataSet
    from butterfly.model.parameters import AddedMass, LumpedParameters


@dataclass(frozen=True, kw_only=True, eq=False)
class Start:
    """A first guess.

    Parameters
    ----------
    parameters
        Of the bare hand.
    zeros
        The encoder's reading in rad at rest for each added mass.
    """

    parameters: LumpedParameters
    zeros: Mapping[AddedMass, float]


def starts(data: DataSet) -> list[Start]:
    """Return the estimates of all closed forms that the logs allow.

    Raises
    ------
    ButterflyError
        If they allow none.
    """
    found: list[Start] = []
    refusals: list[ButterflyError] = []
    for closed_form in (_from_sines, _from_any):
        try:
            start = closed_form(data)
        except ButterflyError as refusal:
            refusals.append(refusal)
            continue
        if start.parameters.p1 + min(mass.inertia for mass in data.masses) > 0:
            found.append(start)
    if not found:
        raise refusals[-1]
    return found


def _from_sines(data: DataSet) -> Start:
    found = HarmonicBalance(check=False)(data)
    zero = found.local.get(None, {}).get("zero")
    zeros = data.equilibria if zero is None else dict.fromkeys(data.masses, zero)
    return Start(parameters=found.parameters, zeros=zeros)


def _from_any(data: DataSet) -> Start:
    """Fit the weak form with the terms that it chooses.

    Where a hand that decays comes to rest depends on friction: the offset of gravity that is seen
    about the rest angles corrects them.
    """
    zeros = data.equilibria
    found = WeakForm(check=False)(data).parameters
    loaded = {mass: found.with_added_mass(mass) for mass in zeros}
    turned = {mass: math.atan2(p.p3_offset, p.p3) for mass, p in loaded.items()}
    corrected = {mass: zero - turned[mass] for mass, zero in zeros.items()}
    return Start(parameters=replace(found, p3_offset=0.0), zeros=corrected)
