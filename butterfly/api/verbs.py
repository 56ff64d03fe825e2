"""`identify`, and what all verbs of an estimate take."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from operator import index
from os import PathLike
from typing import Any

from butterfly.api.identification import Identification
from butterfly.api.joint_models import with_heavier_neighbours
from butterfly.api.saved import load
from butterfly.api.sources import Data, Named, names_result, read
from butterfly.arguments import checked
from butterfly.errors import InputError
from butterfly.experiment.methods import make_estimator
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import DEFAULT_METHOD, Estimator
from butterfly.identification.identified import read_parameters
from butterfly.identification.identify import identify as identify_data
from butterfly.identification.identify import judged, with_other
from butterfly.model.parameters import LumpedParameters
from butterfly.progress import Track, phase, untracked

Method = str | Estimator


@checked
def identify(
    data: Data,
    method: Method = DEFAULT_METHOD,
    *,
    against: Mapping[str, Identification | LumpedParameters | Mapping[str, Any]] | None = None,
    holdout: Sequence[str] = (),
    track: Track = untracked,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Identification:
    """Identify the joint from logs.

    The result has a verdict, and the parameters with 95 % intervals.

    Parameters
    ----------
    data
        Logs, a folder of logs, a manifest, a saved result, or a shipped data set's name. Anything
        else that `read` takes, or its result.
    method
        ``output-error``, the same as ``auto``; ``weak-form``; or, for a fast look at sines,
        ``harmonic-balance``, ``linear`` or ``thesis``; or an `Estimator`.
    against
        Parameters to compare with: p1=0.003,p2=0.001,p3=0.05. Without p4, the best-fitting one.
        In Python a mapping from names to an `Identification`, `LumpedParameters` or mappings.
    holdout
        Names or glob patterns of held-out logs: predicted, never fitted.
    track
        Progress callback.
    options
        Options of the method, named as in `butterfly identify --help-all`: ``terms=("drag",)``.
    """
    if not isinstance(against, Mapping | None):
        raise InputError("identify", "against", against, "a mapping of names to parameters")
    others = {name: _parameters(name, given) for name, given in (against or {}).items()}
    logs, estimator = prepared(data, method, options, holdout)
    with phase("Identifying"):
        identified = identify_data(logs, estimator, against=others, track=track)
        if (heavier := with_heavier_neighbours(logs)) is not None:
            # what was taken off the input rests on the masses of links
            other = estimator(heavier).named
            identified = replace(identified, estimate=with_other(identified.estimate, other))
        return Identification.of(identified)


def saved_identification(data: Data) -> Identification | None:
    """Return data that are an identification, or its saved file; None for other data."""
    if isinstance(data, Identification):
        return data
    if names_result(data):
        result = load(data)
        if isinstance(result, Identification):
            return result
        raise InputError(data, "schema", result.kind, "a saved identification")
    return None


def require_identification(result: Identification | Named, verb: str = "predict") -> Identification:
    """Return an identification, loaded if need be; InputError for anything else."""
    identification = load(result) if isinstance(result, str | PathLike) else result
    if not isinstance(identification, Identification):
        expected = "an identification or its saved file"
        raise InputError(verb, "result", type(identification).__name__, expected)
    return identification


def prepared(
    data: Data, method: Method, options: Mapping[str, Any], holdout: Sequence[str]
) -> tuple[DataSet, Estimator]:
    """Return logs and the estimator of a method; a wrong option is refused first."""
    estimator = make_estimator(method, options)
    logs = read(data).holding_out(holdout)
    return logs, estimator


def estimated(
    data: Data, method: Method | None, options: Mapping[str, Any], holdout: Sequence[str]
) -> tuple[DataSet, Estimator | None, Estimate]:
    """Return logs, estimator and estimate: of a result, or identified now."""
    result = saved_identification(data)
    if result is not None:
        if method is not None or options or holdout:
            others = {"method": method is not None, "holdout": holdout}
            names = [*(name for name, value in others.items() if value), *options]
            expected = "no such option with a saved result, which already has an estimate"
            raise InputError("butterfly", "option", options_text(names), expected)
        return result.data, result.made_by, result.estimate
    logs, estimator = prepared(data, method or DEFAULT_METHOD, options, holdout)
    logs, fitted = judged(logs, estimator)
    return logs, estimator, fitted


def options_text(names: Iterable[str]) -> str:
    """Name parameters of verbs as options of their commands."""
    return ", ".join(f"--{'log' if name == 'logs' else name.replace('_', '-')}" for name in names)


def _parameters(name: str, given: Any) -> LumpedParameters:  # noqa: ANN401 - whatever was given
    if isinstance(given, Identification | LumpedParameters):
        return given if isinstance(given, LumpedParameters) else given.parameters
    if not isinstance(given, Mapping):
        raise InputError("against", name, given, "parameters by name, such as {'p1': 0.003, ...}")
    return read_parameters(given, f"against {name}")


def numbers_of_logs(verb: str, logs: Sequence[int] | None, count: int) -> list[int]:
    """Return the checked numbers of logs; all if ``logs`` is None."""
    if logs is None:
        return list(range(count))
    try:
        numbers = [index(number) for number in logs]
    except TypeError:
        raise InputError(verb, "logs", logs, "log numbers (integers)") from None
    for number in numbers:
        if not 0 <= number < count:
            raise InputError(verb, "logs", number, f"numbers from 0 to {count - 1}")
    if not numbers:
        raise InputError(verb, "logs", "none", "at least one number")
    return numbers
