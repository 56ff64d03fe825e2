"""Where iterations start: a closed form's parameters, and rest angles of the encoder."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from butterfly.errors import IdentifiabilityError
from butterfly.identify.estimators.harmonic_balance import HarmonicBalance
from butterfly.identify.estimators.weak_form import WeakForm

if TYPE_CHECKING:
    from butterfly.identify.data import DataSet
    from butterfly.model.parameters import AddedMass, LumpedParameters


def closed_form_start(data: DataSet) -> tuple[LumpedParameters, dict[AddedMass, float]]:
    """Return a closed form's estimate, from the sines alone if they suffice, and rest angles.

    Where a hand that decays comes to rest depends on friction; the weak form, which then takes
    over, corrects the rest angles by the offset of gravity that it sees about them.

    Returns
    -------
    Parameters of the bare hand, and the encoder's reading in rad at rest for each added mass.
    """
    zeros = data.equilibria
    try:
        return HarmonicBalance(check=False)(data).parameters, zeros
    except IdentifiabilityError:
        found = WeakForm(terms=("p3_offset",), check=False)(data).parameters
        loaded = {mass: found.with_added_mass(mass) for mass in zeros}
        turned = {mass: math.atan2(p.p3_offset, p.p3) for mass, p in loaded.items()}
        corrected = {mass: zero - turned[mass] for mass, zero in zeros.items()}
        return replace(found, p3_offset=0.0), corrected
