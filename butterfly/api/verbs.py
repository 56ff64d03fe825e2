"""Verbs that estimate: identify, select, validate, residual, compare, design."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from numbers import Real
from operator import index
from typing import Any

from butterfly.api.compared import Compared, Leaderboard
from butterfly.api.results import Designed, Residual, Selection, Validated
from butterfly.api.saved import load
from butterfly.api.sources import Data, choice, names_result, read
from butterfly.errors import InputError
from butterfly.experiment.methods import DEFAULT_METHOD, make_estimator
from butterfly.identification.data import DataSet
from butterfly.identification.design import next_experiments
from butterfly.identification.diagnostics.residuals import residuals_of
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.identification import Identification
from butterfly.identification.identify import identify as identify_data
from butterfly.identification.identify import judged
from butterfly.identification.inference.term_choice import CANDIDATES
from butterfly.identification.parameters_by_hand import read_parameters
from butterfly.identification.splits import Split
from butterfly.identification.validate import bootstrap as bootstrap_of
from butterfly.identification.validate import (
    cross_validate,
    cross_validate_choice,
    select_terms,
)
from butterfly.model.parameters import LumpedParameters
from butterfly.model.terms import OF_ANGLE, offered
from butterfly.progress import Track, untracked
from butterfly.report.finding_texts import require_possible

Method = str | Estimator


def identify(
    data: Data,
    method: Method = DEFAULT_METHOD,
    *,
    against: Mapping[str, Identification | LumpedParameters | Mapping[str, Any]] | None = None,
    holdout: Sequence[str] = (),
    track: Track = untracked,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Identification:
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
        Names or glob patterns of logs that are not used for the fit, only predicted by it.
    track
        Shows progress.
    options
        Of the method, as `butterfly identify --help-all` names them: ``terms=("drag",)``, ...

    Raises
    ------
    InputError
        If the logs cannot be used, or an option is not the method's.
    IdentifiabilityError
        If they cannot determine the parameters.
    """
    if not isinstance(against, Mapping | None):
        raise InputError("identify", "against", against, "parameters by a name for them")
    others = {name: _parameters(name, given) for name, given in (against or {}).items()}
    logs, estimator = _prepared(data, method, options, holdout)
    return identify_data(logs, estimator, against=others, track=track)


def select(
    data: Data,
    method: Method = "output-error",
    *,
    candidates: Collection[str] = CANDIDATES,
    holdout: Sequence[str] = (),
    nested: bool = False,
    track: Track = untracked,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Selection:
    """Choose friction terms by how well they predict what was left out: added masses, or logs.

    Terms are added one by one, the most helpful first, until none helps by more than the standard
    error of its gain. The verdict is on the
    estimate with the terms that were chosen.

    Parameters
    ----------
    data, method, holdout, track, options
        As `identify` takes them; the terms are not among the options.
    candidates
        Terms to choose from.
    nested
        Choose anew without each of the parts that are left out, too: what that predicts is no
        better for having been chosen by it.

    Raises
    ------
    InputError
        If the logs cannot be used, or an option or a term is not the method's.
    IdentifiabilityError
        If they cannot determine the parameters, or nothing can be left out.
    """
    if isinstance(candidates, str) or not isinstance(candidates, Collection):
        raise InputError("select", "candidates", candidates, f"names, such as {CANDIDATES}")
    logs = read(data).holding_out(holdout)
    estimator = make_estimator(method, options)
    wanted = tuple(candidates)
    if wanted == CANDIDATES:
        able = offered(estimator.method)
        unable = OF_ANGLE if any(log.integrated for log in logs.logs) else ()
        wanted = tuple(name for name in wanted if name in able and name not in unable)
    passed = select_terms(logs, estimator, wanted, track=track)
    chosen = estimator.with_terms(passed[-1].terms)
    found = judged(logs, chosen)
    anew = cross_validate_choice(logs, estimator, wanted, track=track) if nested else None
    return Selection.of(logs, chosen, wanted, passed, found=found, nested=anew)


def validate(
    data: Data,
    method: Method | Sequence[Method] = DEFAULT_METHOD,
    *,
    split: str = Split.AUTO,
    folds: int | None = None,
    holdout: Sequence[str] = (),
    bootstrap: int = 0,
    track: Track = untracked,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Validated | Leaderboard:
    """Predict logs that an estimator has not seen, and compare with those it has.

    Parameters
    ----------
    data, method, holdout, track, options
        As `identify` takes them; of several methods in a list the best comes first, each with its
        own defaults.
    split
        What is left out together: ``mass``, ``frequency``, ``log``, ``time``, or ``auto``: the
        first of these that suits the logs.
    folds
        How many parts, of frequency, log and time.
    bootstrap
        How often to estimate from logs drawn with replacement besides, for intervals.

    Raises
    ------
    InputError
        If the logs cannot be used, or an option is not the method's.
    IdentifiabilityError
        If nothing can be left out, or a part cannot determine the parameters.
    """
    how = choice(Split, "validate", "split", split)
    _require_count("folds", folds, 2)
    _require_count("bootstrap", bootstrap, 0)
    if not isinstance(method, str | Estimator):
        for name, value in {"folds": folds, "bootstrap": bootstrap or None, **options}.items():
            if value is not None:
                raise InputError("validate", name, value, "none beside several methods")
        return rank([data], method, split=how, holdout=holdout, track=track)
    logs, estimator = _prepared(data, method, options, holdout)
    held = cross_validate(logs, estimator, how, folds=folds, track=track)
    whole, drawn = judged(logs, estimator), None
    if bootstrap:
        drawn = bootstrap_of(logs, estimator, whole, repetitions=bootstrap, track=track)
    return Validated.of(logs, estimator, held, whole, drawn)


def rank(
    sets: Sequence[Data],
    methods: Sequence[Method],
    *,
    split: str,
    holdout: Sequence[str],
    track: Track,
) -> Leaderboard:
    """Rank methods by how well they predict what they have not seen, each data set by itself."""
    from butterfly.comparison.leaderboard import leaderboard  # noqa: PLC0415 - slow to import

    how = choice(Split, "validate", "split", split)
    estimators = [make_estimator(each, {}) for each in methods]
    if not estimators:
        raise InputError("validate", "method", "none", "at least one method")
    entries = leaderboard(
        [read(each).holding_out(holdout) for each in sets], estimators, split=how, track=track
    )
    return Leaderboard.of(entries)


def residual(
    data: Data,
    method: Method | None = None,
    *,
    logs: Sequence[int] | None = None,
    holdout: Sequence[str] = (),
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Residual:
    """Show the residuals of the identified model: errors of free runs, and what explains them.

    Errors stand beside what encoder and noise explain, with the terms that the model lacks.

    Parameters
    ----------
    data, method, holdout, options
        As `identify` takes them; or its result, fresh or saved, whose estimate is taken.
    logs
        Numbers of the logs that are shown; all if not given.

    Raises
    ------
    InputError
        If the logs cannot be used, or an option is not the method's.
    IdentifiabilityError
        If they cannot determine the parameters.
    """
    whole, estimator, found = _estimated(data, method, options, holdout)
    chosen = numbers_of_logs("residual", logs, len(whole.logs))
    return Residual.of(whole, estimator, found, chosen)


def compare(
    data: Data,
    method: Method | None = None,
    *,
    logs: Sequence[int] | None = None,
    mass: float | None = None,
    holdout: Sequence[str] = (),
    track: Track = untracked,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Compared:
    """Simulate logs in MuJoCo and by the grey-box model, with the parameters identified from them.

    Parameters
    ----------
    data, method, holdout, track, options
        As `identify` takes them; or its result, fresh or saved, whose estimate is taken.
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
    from butterfly.comparison.three_way import compare_three  # noqa: PLC0415 - slow to import

    if not isinstance(mass, Real | None):
        raise InputError("compare", "mass", mass, "a number of kg")
    whole, estimator, found = _estimated(data, method, options, holdout)
    require_possible(found)
    numbers = numbers_of_logs("compare", logs, len(whole.logs))
    compared = compare_three(whole, found, numbers, mass=mass, track=track)
    return Compared.of(whole, estimator, compared, residuals_of(whole, found), found)


def design(
    data: Data,
    method: Method | None = None,
    *,
    swing: float | None = None,
    holdout: Sequence[str] = (),
    track: Track = untracked,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Designed:
    """Rank candidate next experiments by how much they would tell.

    Parameters
    ----------
    data, method, holdout, track, options
        As `identify` takes them; or its result, fresh or saved, whose estimate is taken.
    swing
        Largest swing allowed, in rad (1 if not given), or on a slide in m (what its logs have
        shown if not given, as those of a servo, whose runs are set-points).

    Raises
    ------
    InputError
        If the logs cannot be used, or an option is not the method's.
    IdentifiabilityError
        If they cannot determine the parameters, or give no covariance.
    UnusableError
        If no joint has the parameters that were found.
    """
    logs, estimator, found = _estimated(data, method, options, holdout)
    require_possible(found)
    ranked = next_experiments(logs, found, largest_swing=swing, track=track)
    return Designed.of(logs, estimator, found, ranked)


def saved_identification(data: Data) -> Identification | None:
    """Return the result that a file holds, or that data are already; None for other data."""
    if isinstance(data, Identification):
        return data
    if names_result(data):
        found = load(data)
        if isinstance(found, Identification):
            return found
        raise InputError(data, "schema", found.kind, "an identification that butterfly saved")
    return None


def _prepared(
    data: Data, method: Method, options: Mapping[str, Any], holdout: Sequence[str]
) -> tuple[DataSet, Estimator]:
    estimator = make_estimator(method, options)  # a wrong option is refused first
    logs = read(data).holding_out(holdout)
    return logs, estimator.suited(logs)


def _estimated(
    data: Data, method: Method | None, options: Mapping[str, Any], holdout: Sequence[str]
) -> tuple[DataSet, Estimator | None, Estimate]:
    """Return logs, an estimator, and its judged estimate; a result, saved or not, has them."""
    found = saved_identification(data)
    if found is not None:
        if method is not None or options or holdout:
            names = [*options, *(["holdout"] if holdout else [])]
            given = ", ".join(names) if method is None else str(method)
            expected = "none beside a result, which has its estimate"
            raise InputError("butterfly", "method", given, expected)
        return found.data, found.made_by, found.estimate
    logs, estimator = _prepared(data, method or DEFAULT_METHOD, options, holdout)
    return logs, estimator, judged(logs, estimator)


def _parameters(name: str, given: Any) -> LumpedParameters:  # noqa: ANN401 - whatever was given
    if isinstance(given, Identification | LumpedParameters):
        return given if isinstance(given, LumpedParameters) else given.parameters
    if not isinstance(given, Mapping):
        expected = "parameters by their names, such as {'p1': 0.003, ...}"
        raise InputError("against", name, given, expected)
    return read_parameters(given, f"against {name}")


def _require_count(name: str, value: object, least: int) -> None:
    if value is None:
        return
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise InputError("validate", name, value, f"an integer, at least {least}")


def numbers_of_logs(verb: str, logs: Sequence[int] | None, count: int) -> list[int]:
    """Return the numbers of the logs that are meant; all if none are given."""
    if logs is None:
        return list(range(count))
    try:
        numbers = [index(number) for number in logs]
    except TypeError:
        raise InputError(verb, "logs", logs, "numbers of logs") from None
    for number in numbers:
        if not 0 <= number < count:
            raise InputError(verb, "logs", number, f"numbers from 0 to {count - 1}")
    if not numbers:
        raise InputError(verb, "logs", "none", "at least one number")
    return numbers
