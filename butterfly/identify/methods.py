"""The estimators to choose from: each takes a data set and gives an estimate."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

from butterfly.errors import IdentifiabilityError
from butterfly.identify.comparison import best_gain
from butterfly.identify.free_run_problem import Loss, OutputErrorOptions
from butterfly.identify.harmonic_balance import fit_harmonic_balance, fit_linear
from butterfly.identify.output_error import fit_output_error
from butterfly.identify.thesis import DECIMATION, fit_thesis
from butterfly.identify.weak_form import fit_weak_form

if TYPE_CHECKING:
    from collections.abc import Callable

    from butterfly.identify.data import DataSet
    from butterfly.identify.estimate import ParameterEstimate
    from butterfly.model.parameters import AddedMass, LumpedParameters


class Method(StrEnum):
    """Estimators to choose from."""

    HARMONIC_BALANCE = "harmonic-balance"
    OUTPUT_ERROR = "output-error"
    WEAK_FORM = "weak-form"
    LINEAR = "linear"
    THESIS = "thesis"


@dataclass(frozen=True, kw_only=True)
class Options:
    """What a method may be told.

    Parameters
    ----------
    terms
        Fitted besides p1..p4, Coulomb torque and delay; the method's own choice if None.
    loss
        Output error only: see `OutputErrorOptions`.
    check
        Output error only: whether to fit again without each added mass.
    decimation
        Thesis only: every how-manieth sample is used.
    """

    terms: tuple[str, ...] | None = None
    loss: Loss = Loss.LINEAR
    check: bool = True
    decimation: int = DECIMATION


def estimate(data: DataSet, method: Method, options: Options | None = None) -> ParameterEstimate:
    """Estimate the parameters by a method.

    Raises
    ------
    InputError
        If the method cannot use the logs, or there is no such term.
    IdentifiabilityError
        If the logs cannot determine the parameters.
    """
    return _METHODS[method](data, options or Options())


def _harmonic_balance(data: DataSet, options: Options) -> ParameterEstimate:
    return fit_harmonic_balance(data.sines, options.terms or ())


def _output_error(data: DataSet, options: Options) -> ParameterEstimate:
    choice = OutputErrorOptions(loss=options.loss, check=options.check)
    if options.terms is not None:
        choice = replace(choice, terms=options.terms)
    start, zeros = _start(data)
    return fit_output_error(data.logs, start, zeros, choice)


def _start(data: DataSet) -> tuple[LumpedParameters, dict[AddedMass, float]]:
    """Return a closed form's estimate, from the sines alone if they suffice, and rest angles.

    Where a hand that decays comes to rest depends on friction; the weak form, which then takes
    over, corrects the rest angles by the offset of gravity that it sees about them.
    """
    zeros = data.equilibria
    try:
        return fit_harmonic_balance(data.sines).parameters, zeros
    except IdentifiabilityError:
        found = fit_weak_form(data.logs, zeros, ("p3_offset",)).parameters
        loaded = {mass: found.with_added_mass(mass) for mass in zeros}
        turned = {mass: math.atan2(p.p3_offset, p.p3) for mass, p in loaded.items()}
        corrected = {mass: zero - turned[mass] for mass, zero in zeros.items()}
        return replace(found, p3_offset=0.0), corrected


def _weak_form(data: DataSet, options: Options) -> ParameterEstimate:
    if options.terms is None:
        return fit_weak_form(data.logs, data.equilibria)
    return fit_weak_form(data.logs, data.equilibria, options.terms)


def _thesis(data: DataSet, options: Options) -> ParameterEstimate:
    found = fit_thesis(data.recorded, options.decimation)
    return found.with_gain(best_gain(found.parameters, data))


_METHODS: dict[Method, Callable[[DataSet, Options], ParameterEstimate]] = {
    Method.HARMONIC_BALANCE: _harmonic_balance,
    Method.OUTPUT_ERROR: _output_error,
    Method.WEAK_FORM: _weak_form,
    Method.LINEAR: lambda data, _: fit_linear(data.sines),
    Method.THESIS: _thesis,
}
