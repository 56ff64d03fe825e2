"""Verbs that estimate: identify, select, validate, residual, compare, design."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from numbers import Real
from operator import index
from typing import Any

import numpy as np

from butterfly.api.compared import comparison_answer, ranking_answer
from butterfly.api.identification import Identification
from butterfly.api.results import (
    design_answer,
    residual_answer,
    selection_answer,
    validation_answer,
)
from butterfly.api.saved import load
from butterfly.api.sources import Data, names_result, read
from butterfly.arguments import checked
from butterfly.errors import InputError
from butterfly.experiment.methods import make_estimator
from butterfly.identification.data import DataSet
from butterfly.identification.design import next_experiments, wanted
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import DEFAULT_METHOD, Estimator
from butterfly.identification.identified import read_parameters
from butterfly.identification.identify import identify as identify_data
from butterfly.identification.identify import judged
from butterfly.identification.parameter import DRAWS
from butterfly.identification.residuals import residuals_of
from butterfly.identification.validate import (
    Split,
    cross_validate,
    cross_validate_choice,
    select_terms,
)
from butterfly.identification.validate import bootstrap as bootstrap_of
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import COMMON, OF_ANGLE, offered
from butterfly.progress import Track, phase, untracked
from butterfly.report.finding_texts import require_possible, require_values
from butterfly.result import Answer

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
        ``output-error``, which ``auto`` is too; ``weak-form``; or, for a fast look at sines,
        ``harmonic-balance``, ``linear`` or ``thesis``; or an `Estimator`.
    against
        Parameters to compare with: p1=0.003,p2=0.001,p3=0.05. Without p4 the best-fitting p4.
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
    logs, estimator = _prepared(data, method, options, holdout)
    with phase("Identifying"):
        return Identification.of(identify_data(logs, estimator, against=others, track=track))


@checked
def select(
    data: Data,
    method: Method = "output-error",
    *,
    candidates: Collection[str] = COMMON,
    holdout: Sequence[str] = (),
    nested: bool = False,
    track: Track = untracked,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Answer:
    """Choose terms as identify does, and show what each choice predicts.

    Each round adds the term that predicts held-out logs best, or takes one away that does not help.
    Every set of terms has its FIT in sample and on held-out added masses, or logs. The verdict is
    on the model with the chosen terms.

    Parameters
    ----------
    data, method, holdout, track, options
        As in `identify`, without ``terms``.
    candidates
        Terms to choose from.
    nested
        Nested cross-validation: repeats the choice without each held-out part, for an unbiased FIT
        (slow).
    """
    if isinstance(candidates, str) or not isinstance(candidates, Collection):
        raise InputError("select", "candidates", candidates, f"names, such as {COMMON}")
    logs = read(data).holding_out(holdout)
    estimator = make_estimator(method, options)
    wanted = tuple(candidates)
    if wanted == COMMON:
        able = offered(estimator.method)
        unable = OF_ANGLE if any(log.integrated for log in logs.logs) else ()
        wanted = tuple(name for name in wanted if name in able and name not in unable)
    passed = select_terms(logs, estimator, wanted, track=track)
    chosen = estimator.with_terms(passed[-1].terms)
    _, estimate = judged(logs, chosen)
    anew = cross_validate_choice(logs, estimator, wanted, track=track) if nested else None
    return selection_answer(logs, chosen, wanted, passed, estimate=estimate, nested=anew)


@checked
def validate(
    data: Data,
    method: Method | Sequence[Method] = DEFAULT_METHOD,
    *,
    others: Sequence[Data] = (),
    split: str = Split.AUTO,
    folds: int | None = None,
    holdout: Sequence[str] = (),
    bootstrap: int = 0,
    track: Track = untracked,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Answer:
    """Cross-validate an estimator on held-out logs, or rank several.

    With several methods or data sets, ranks the methods by their median FIT on held-out logs.

    Parameters
    ----------
    data
        A data set (logs, a folder of logs, a manifest, a saved result, or a shipped name), or
        several to rank methods on. In Python the first, as in `identify`.
    method, holdout, track, options
        As in `identify`; of several methods, each has its defaults.
    others
        More data sets to rank the methods on.
    split
        What to hold out at a time: an added mass (``mass``), sine frequencies (``frequency``), logs
        (``log``), a section of every log (``time``), or the first of these that the data allow
        (``auto``).
    folds
        Number of parts for frequency, log and time. Default: 5, or fewer if the data require it.
    bootstrap
        Number of bootstrap samples of the logs, for 95 % intervals.
    """
    if split not in [*Split]:
        raise InputError("validate", "split", split, " or ".join(Split))
    fewest = DRAWS if bootstrap else 0
    for name, value, least in (("folds", folds, 2), ("bootstrap", bootstrap, fewest)):
        if value is None:
            continue
        if not isinstance(value, int) or isinstance(value, bool) or value < least:
            raise InputError("validate", name, value, f"an integer of {least} or more")
    if others or not isinstance(method, str | Estimator):
        for name, value in {"folds": folds, "bootstrap": bootstrap or None, **options}.items():
            if value is not None:
                expected = "no such option with several methods or data sets"
                raise InputError("validate", name, value, expected)
        from butterfly.comparison.leaderboard import leaderboard  # noqa: PLC0415 - slow to import

        methods = [method] if isinstance(method, str | Estimator) else method
        estimators = [make_estimator(candidate, {}) for candidate in methods]
        if not estimators:
            raise InputError("validate", "method", "none", "at least one method")
        sets = [read(source).holding_out(holdout) for source in (data, *others)]
        return ranking_answer(leaderboard(sets, estimators, split=Split(split), track=track))
    logs, estimator = _prepared(data, method, options, holdout)
    (logs, whole), drawn = judged(logs, estimator), None
    held = cross_validate(logs, estimator, Split(split), folds=folds, track=track)
    if bootstrap:
        drawn = bootstrap_of(logs, estimator, whole, repetitions=bootstrap, track=track)
    return validation_answer(logs, estimator, held, whole, drawn)


@checked
def residual(
    data: Data,
    method: Method | None = None,
    *,
    logs: Sequence[int] | None = None,
    holdout: Sequence[str] = (),
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Answer:
    """Analyse the residuals, and name the terms that the model is missing.

    Compares each log's free-run error with the sensor noise, and tests its correlations.

    Parameters
    ----------
    data
        A saved result; or logs, a folder of logs, a manifest or a shipped data set's name, to
        identify first. An `Identification`; anything else that `read` takes, or its result.
    method, holdout, options
        As in `identify`; none with a result, which has an estimate.
    logs
        Numbers of the logs to show, from 0. Default: all.
    """
    whole, estimator, estimate = _estimated(data, method, options, holdout)
    numbers = numbers_of_logs("residual", logs, len(whole.logs))
    return residual_answer(whole, estimator, estimate, numbers)


@checked
def compare(
    data: Data,
    method: Method | None = None,
    *,
    logs: Sequence[int] | None = None,
    hand_mass: float | None = None,
    holdout: Sequence[str] = (),
    track: Track = untracked,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Answer:
    """Simulate logs in MuJoCo and with the grey-box model, both with the identified parameters.

    Parameters
    ----------
    data, method, logs, holdout, options
        As in `residual`.
    hand_mass
        Mass of the moving body in MuJoCo, in kg; the motion does not depend on it. Default: chosen.
    track
        Progress callback.
    """
    from butterfly.comparison.three_way import compare_three  # noqa: PLC0415 - slow to import

    if not isinstance(hand_mass, Real | None):
        raise InputError("compare", "hand_mass", hand_mass, "a number in kg")
    whole, estimator, estimate = _estimated(data, method, options, holdout)
    require_values(estimate, "a simulation in MuJoCo")
    numbers = numbers_of_logs("compare", logs, len(whole.logs))
    compared = compare_three(whole, estimate, numbers, mass=hand_mass, track=track)
    return comparison_answer(whole, estimator, compared, residuals_of(whole, estimate), estimate)


@checked
def design(
    data: Data,
    *,
    goal: float | str = "1%",
    duration: float = 40.0,
    command: float | None = None,
    swing: float | None = None,
    price: float = 120.0,
    track: Track = untracked,
) -> Answer:
    """Say which run to do next: the one from which a goal is reached for the least robot time.

    Candidates: sines, multisines and free decays, with each added mass and without. Each one is
    simulated with the identified parameters.

    Parameters
    ----------
    data
        As in `residual`; logs are identified by the default method.
    goal, price
        As in `campaign`. The last log's mass is taken as mounted.
    duration
        Length of a run in s; of a servo at most that of its logs.
    command
        Largest command, in units of the input. Default: the largest one logged.
    swing
        Largest allowed swing in rad (m on a slide). Default: 1; on a slide or servo, the logs'
        largest.
    track
        Progress callback.
    """
    share = share_of(goal)
    logs, estimator, estimate = _estimated(data, None, {}, ())
    require_possible(estimate)
    aim = wanted(estimate.at_limit, logs.logs, share)
    limits: dict[str, Any] = {"duration": duration, "command": command, "swing": swing}
    ranked = next_experiments(logs, estimate, aim, **limits, price=price, track=track)
    now = float(np.max(estimate.farther / aim))
    return design_answer(logs, estimator, estimate, ranked, goal=share, now=share * now)


def share_of(goal: float | str) -> float:
    """Return a goal as a share, given as one or in per cent."""
    try:
        share = (
            float(goal[:-1]) / 100 if isinstance(goal, str) and goal[-1:] == "%" else float(goal)
        )
    except ValueError:
        share = float("nan")
    if not 0 < share < 1:
        expected = "a share between 0 and 1, such as 0.01 or 1%"
        raise InputError("butterfly", "goal", goal, expected)
    return share


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


def _prepared(
    data: Data, method: Method, options: Mapping[str, Any], holdout: Sequence[str]
) -> tuple[DataSet, Estimator]:
    estimator = make_estimator(method, options)  # a wrong option is refused first
    logs = read(data).holding_out(holdout)
    return logs, estimator


def _estimated(
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
    logs, estimator = _prepared(data, method or DEFAULT_METHOD, options, holdout)
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
