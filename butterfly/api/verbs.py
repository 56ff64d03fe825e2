"""What `import butterfly as bf` can do: read, identify, simulate, validate, design, compare."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import index
from os import PathLike
from pathlib import Path
from typing import Any

from butterfly.api.identified import Identified
from butterfly.api.sources import Data, Named, choice, read, read_experiment
from butterfly.api.tabulated import Compared, Designed, Validated
from butterfly.api.usable import require_possible
from butterfly.comparison.three_way import compare_three
from butterfly.errors import InputError
from butterfly.experiment.estimator_spec import make_estimator
from butterfly.experiment.methods import DEFAULT_METHOD
from butterfly.experiment.schema import Experiment
from butterfly.experiment.simulation import data_set_of, write_logs
from butterfly.experiment.simulation import simulate as simulated_logs
from butterfly.identification.data import DataSet, read_data_set
from butterfly.identification.design import next_experiments
from butterfly.identification.diagnostics.misfit import judge_misfit
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.identification import identify as identify_data
from butterfly.identification.identification import judged
from butterfly.identification.inference.splits import Split
from butterfly.identification.inference.validation import hold_out
from butterfly.identification.other_parameters import told_parameters
from butterfly.logs.manifest import read_manifest
from butterfly.model.parameters import LumpedParameters
from butterfly.report.numbers.table_numbers import told_design, told_validation

Method = str | Estimator


def identify(
    data: Data,
    method: Method = DEFAULT_METHOD,
    *,
    against: Mapping[str, Identified | LumpedParameters | Mapping[str, float]] | None = None,
    holdout: Sequence[str] = (),
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Identified:
    """Identify the robot that made the logs.

    Parameters
    ----------
    data
        What `read` takes, or has read.
    method
        ``harmonic-balance``, ``output-error``, ``weak-form``, ``linear``, ``thesis``, an
        estimator, or ``auto``: harmonic balance where all logs are sines, else output error.
    against
        Other parameters to simulate the logs with, by name; without p4 the best one is used.
    holdout
        Names or glob patterns of logs that are not used for the fit, only foretold by it.
    options
        Of the method, as `butterfly identify --help` names them: ``terms=("drag",)``, ...

    Raises
    ------
    InputError
        If the logs cannot be used, or an option is not the method's.
    IdentifiabilityError
        If they cannot determine the parameters.
    """
    logs = read(data).holding_out(holdout)
    estimator = make_estimator(method, options).suited(logs)
    if not isinstance(against, Mapping | None):
        raise InputError("identify", "against", against, "parameters by a name for them")
    others = {name: _parameters(name, given) for name, given in (against or {}).items()}
    found = identify_data(logs, estimator, against=others)
    return Identified.of(found, estimator.label)


def simulate(experiment: Named | Experiment, *, out: Named | None = None) -> DataSet:
    """Simulate an experiment in MuJoCo, and return its logs.

    Parameters
    ----------
    experiment
        A file, the name of a shipped one, or what `read_experiment` returned.
    out
        Folder to which the logs are written with their manifest, in the form of the real ones.

    Raises
    ------
    InputError
        If the experiment is not one, or a simulation diverges.
    """
    plan = read_experiment(experiment) if isinstance(experiment, str | PathLike) else experiment
    if not isinstance(plan, Experiment):
        expected = "an experiment: its file, its name, or what read_experiment returned"
        raise InputError("simulate", "experiment", type(plan).__name__, expected)
    logs = list(simulated_logs(plan))
    if out is not None:
        return read_data_set(read_manifest(write_logs(plan, logs, Path(out))))
    return data_set_of(plan, logs)


def validate(
    data: Data,
    method: Method = DEFAULT_METHOD,
    *,
    split: str = Split.AUTO,
    folds: int | None = None,
    holdout: Sequence[str] = (),
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Validated:
    """Predict logs that an estimator has not seen, and compare with those it has.

    Parameters
    ----------
    data, method, options
        As `identify` takes them.
    split
        What is left out together: ``mass``, ``frequency``, ``log``, ``time``, or ``auto``: the
        first of these that suits the logs.
    folds
        How many parts, of frequency, log and time.
    holdout
        Names or glob patterns of logs that are neither used nor left out, only foretold at the end.

    Raises
    ------
    InputError
        If the logs cannot be used, or an option is not the method's.
    IdentifiabilityError
        If nothing can be left out, or a part cannot determine the parameters.
    """
    logs = read(data).holding_out(holdout)
    estimator = make_estimator(method, options).suited(logs)
    quick = estimator.unchecked()
    held = hold_out(logs, quick, choice(Split, "validate", "split", split), folds=folds)
    return Validated.of_told(told_validation(logs, estimator, held, judged(logs, quick)))


def design(
    data: Data,
    method: Method | None = None,
    *,
    swing: float | None = None,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Designed:
    """Rank candidate next experiments by how much they would tell.

    Parameters
    ----------
    data, method, options
        As `identify` takes them; or its result alone, whose estimate is taken.
    swing
        Largest swing allowed, in rad (1 if not given), or on a slide in m (what its logs have
        shown if not given).

    Raises
    ------
    InputError
        If the logs cannot be used, or an option is not the method's.
    IdentifiabilityError
        If they cannot determine the parameters, or give no covariance.
    UnusableError
        If no joint has the parameters that were found.
    """
    logs, estimator, found = _estimated(data, method, options)
    require_possible(found)
    ranked = next_experiments(logs, found, largest_swing=swing)
    return Designed.of_told(told_design(logs, estimator, found, ranked))


def compare(
    data: Data,
    method: Method | None = None,
    *,
    logs: Sequence[int] | None = None,
    mass: float | None = None,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Compared:
    """Simulate logs in MuJoCo and by the grey-box model, with the parameters identified from them.

    Parameters
    ----------
    data, method, options
        As `identify` takes them; or its result alone, whose estimate is taken.
    logs
        Numbers of the logs; all if not given.
    mass
        Of the hand in kg, for MuJoCo; the motion does not depend on it, and a possible one is taken
        if it is not given.

    Raises
    ------
    InputError
        If the logs cannot be used, an option is not the method's, or no hand moves so.
    IdentifiabilityError
        If they cannot determine the parameters.
    UnusableError
        If no joint has those that were found.
    """
    whole, estimator, found = _estimated(data, method, options, check=False)
    require_possible(found)
    count = len(whole.logs)
    numbers = list(range(count)) if logs is None else _numbers(logs, count)
    compared = compare_three(whole, found, numbers, mass=mass)
    return Compared.of(whole, estimator, compared, judge_misfit(whole, found), found)


def _estimated(
    data: Data, method: Method | None, options: Mapping[str, Any], *, check: bool = True
) -> tuple[DataSet, Estimator | None, Estimate]:
    """Return logs, an estimator, and its judged estimate; an identification has them already."""
    if isinstance(data, Identified):
        if method is not None or options:
            told = ", ".join(options) if method is None else str(method)
            expected = "none beside a result, which has its estimate"
            raise InputError("butterfly", "method", told, expected)
        return data.data, data.made_by, data.estimate
    logs = read(data)
    estimator = make_estimator(method or DEFAULT_METHOD, options).suited(logs)
    return logs, estimator, judged(logs, estimator if check else estimator.unchecked())


def _parameters(name: str, given: Any) -> LumpedParameters:  # noqa: ANN401 - whatever was given
    if isinstance(given, Identified | LumpedParameters):
        return given if isinstance(given, LumpedParameters) else given.parameters
    if not isinstance(given, Mapping):
        expected = "parameters by their names, such as {'p1': 0.003, ...}"
        raise InputError("against", name, given, expected)
    return told_parameters(given, f"against {name}")


def _numbers(logs: Sequence[int], count: int) -> list[int]:
    try:
        numbers = [index(number) for number in logs]
    except TypeError:
        raise InputError("compare", "logs", logs, "numbers of logs") from None
    for number in numbers:
        if not 0 <= number < count:
            raise InputError("compare", "logs", number, f"numbers from 0 to {count - 1}")
    if not numbers:
        raise InputError("compare", "logs", "none", "at least one number")
    return numbers
