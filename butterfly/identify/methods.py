"""The estimators to choose from: each takes a data set and gives an estimate."""

from __future__ import annotations

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
    from butterfly.model.parameters import LumpedParameters


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
    return fit_output_error(data.logs, _start(data), data.equilibria, choice)


def _start(data: DataSet) -> LumpedParameters:
    """Return a closed form's estimate: from the sines alone if they suffice."""
    try:
        return fit_harmonic_balance(data.sines).parameters
    except IdentifiabilityError:
        return fit_weak_form(data.logs, data.equilibria).parameters


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
