"""The estimators to choose from: each takes a data set and gives an estimate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

from butterfly.identify.comparison import best_gain
from butterfly.identify.free_run_problem import Loss, OutputErrorOptions
from butterfly.identify.harmonic_balance import fit_harmonic_balance
from butterfly.identify.output_error import fit_output_error
from butterfly.identify.thesis import DECIMATION, fit_thesis

if TYPE_CHECKING:
    from collections.abc import Callable

    from butterfly.identify.data import DataSet
    from butterfly.identify.estimate import ParameterEstimate


class Method(StrEnum):
    """Estimators to choose from."""

    HARMONIC_BALANCE = "harmonic-balance"
    OUTPUT_ERROR = "output-error"
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
    start = fit_harmonic_balance(data.sines)
    return fit_output_error(data.logs, start.parameters, data.equilibria, choice)


def _thesis(data: DataSet, options: Options) -> ParameterEstimate:
    found = fit_thesis(data.recorded, options.decimation)
    return found.with_gain(best_gain(found.parameters, data))


_METHODS: dict[Method, Callable[[DataSet, Options], ParameterEstimate]] = {
    Method.HARMONIC_BALANCE: _harmonic_balance,
    Method.OUTPUT_ERROR: _output_error,
    Method.THESIS: _thesis,
}
