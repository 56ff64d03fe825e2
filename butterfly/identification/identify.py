"""From a data set to an answer: start, fit, choose terms, weigh logs, infer; then diagnose.

Each of these is a step of `identify`, and can be taken alone with the fit that the one before ended
with. The first four calls are an estimator's. Here is besides what all share: sines whose clock is
wrong, free runs of the logs, their residuals, and the verdict on these.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from butterfly.errors import ButterflyError, IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import DEFAULT_ESTIMATOR, Estimator, WeakForm
from butterfly.identification.estimators.assumptions import as_taken
from butterfly.identification.free_run import LEAST_FIT, FreeRun, WholeRuns
from butterfly.identification.identified import Identified, try_parameters
from butterfly.identification.limits import Rival
from butterfly.identification.physical import (
    BETTER_METHOD,
    is_possible,
    judge_basis,
    judge_fit,
    judge_input,
    judge_knowledge,
    judge_physics,
    judge_units,
)
from butterfly.identification.repeatability import contradicting_runs
from butterfly.identification.residuals import Residuals, residuals_of
from butterfly.identification.segments import driven_alone
from butterfly.identification.trust import FEW, Finding, FindingKind
from butterfly.identification.unit_error_search import find_slow_clock, find_unit_errors
from butterfly.identification.unit_errors import clock_error, with_unit_errors
from butterfly.model.parameters import LumpedParameters
from butterfly.progress import Track, counted, current_search, tracked, untracked

_NEARLY = 0.5  # of the least squared error over another that follows nearly as well

_CORRECTED = (FindingKind.CLOCK_SET, FindingKind.OMEGA_SET)
_MIMICS = "mass_inertia"  # the term that a wrong clock looks like

_UNWARNED = np.errstate(over="ignore", invalid="ignore", divide="ignore")
"""Values that no joint has overflow: their fit is infinitely bad, which is all that counts."""


def identify(
    data: DataSet,
    estimator: Estimator | None = None,
    *,
    against: Mapping[str, LumpedParameters] = MappingProxyType({}),
    track: Track = untracked,
) -> Identified:
    """Identify the robot that made the logs of a data set.

    `estimator`: Output error if not given; `against`: Other parameters to simulate
    the logs with, by name; a p4 that is NaN is fitted. Raises InputError if the estimator cannot
    use the logs; IdentifiabilityError if the logs cannot determine the parameters.
    """
    estimator = estimator or DEFAULT_ESTIMATOR()
    with counted():
        with _explained(data, estimator):
            data, other = in_true_time(data, estimator)
            problem, fit = tracked(track, "Fitting", estimator.fit, data)  # start and fit
            problem, fit = estimator.choose(problem, fit)
            fit = estimator.weigh(problem, fit)
            estimate = _finite(estimator.infer(problem, fit))
            del problem, fit  # with the derivatives of all logs
        estimate = replace(estimate, input_kind=data.input_kind, joint=data.joint)
        data, estimate = as_taken(data, with_other(estimate, other))
        run = simulated(data, estimate, against=against, track=track)
        residuals = tracked(track, "Checking residuals", residuals_of, data, run.estimate, run.runs)
        sure = diagnose(data, estimator, run.estimate, residuals)
    return replace(
        run, estimate=sure, judged_residuals=residuals, made_by=estimator, estimator=estimator.label
    )


def held_out_fits(data: DataSet, estimate: Estimate) -> dict[str, float]:
    """Return FIT in per cent of each log that is held out, by its name."""
    if data.test_logs is None:
        return {}
    fits = data.test_logs.simulations.fits(estimate)
    return dict(zip((log.name for log in data.test_logs.logs), fits.tolist(), strict=True))


def judged(data: DataSet, estimator: Estimator) -> tuple[DataSet, Estimate]:
    """Return the logs as they were used, and all that `identify` says of their estimate."""
    result = identify(data, estimator)
    return result.data, result.estimate


@_UNWARNED
def diagnose(
    data: DataSet, estimator: Estimator, estimate: Estimate, residuals: Residuals
) -> Estimate:
    """Add to an estimate what physics, its free runs, the input and unit errors say of it."""
    rivals = [residuals.encoder.rival] if residuals.encoder else []
    if residuals.missing.rival is not None:
        rivals.append(Rival(residuals.missing.rival, predicts=False))
    sure = estimate.with_evidence(*rivals).with_findings(
        *judge_physics(estimate, data.masses),
        *([data.correction] if data.correction else []),
        *data.remarks,
        *_unfollowed(data, estimator, estimate, data.simulations.judging(estimate)),
        *residuals.findings,
        *judge_input(estimate, data.input_kind),
        *judge_units(data),
        *judge_knowledge(estimate, data),
        *judge_basis(estimate, data),
    )
    if slips := find_unit_errors(data, estimator, sure):  # which explain what was a guess
        rest = (
            finding for finding in sure.findings if finding.kind is not FindingKind.TORQUE_DRIVEN
        )
        sure = replace(sure, findings=(*slips, *rest))
    else:
        sure = sure.with_findings(*_unrepeated(data, sure))
    search = current_search()
    if not search.left_out:
        return sure
    seconds = None if search.exhausted or math.isinf(search.seconds) else search.seconds
    stopped = Finding(FindingKind.SEARCH_STOPPED, tuple(search.left_out), number=seconds)
    return sure.with_findings(stopped)


def _unfollowed(
    data: DataSet, estimator: Estimator, estimate: Estimate, numbers: Sequence[int]
) -> list[Finding]:
    """Return the finding that logs of some numbers are not followed, most or some, or none.

    Where most are not, it names a method that does better.
    """
    fits = data.simulations.followed(estimate, numbers)
    if poor := judge_fit(fits):
        return [replace(finding, parameters=_better_method(data, estimator)) for finding in poor]
    lost = [data.logs[k].name for k, fit in zip(numbers, fits, strict=True) if not fit >= LEAST_FIT]
    if len(numbers) - len(lost) > FEW * len(lost):  # so many that follow allow to leave it out
        return []
    return [Finding(FindingKind.LOGS_LOST, number=float(len(numbers)), logs=tuple(lost))]


def _better_method(data: DataSet, estimator: Estimator) -> tuple[str, ...]:
    """Return the name of the closed form if its free runs follow logs that an estimator's do not.

    It is tried before it is advised.
    """
    closed_form = WeakForm()
    if estimator.method == closed_form.method:
        return ()
    try:
        estimate = closed_form(data)
        follows = not judge_fit(data.simulations.followed(estimate, data.counted))
    except (ButterflyError, np.linalg.LinAlgError, ArithmeticError):
        return ()
    return (closed_form.method,) if follows and is_possible(estimate, data.masses) else ()


def _unrepeated(data: DataSet, estimate: Estimate) -> list[Finding]:
    """Return the finding of two logs of one mass that contradict each other, or none.

    Where noise explains the errors of all logs, none does.
    """
    if all(finding.kind is not FindingKind.MISFIT for finding in estimate.findings):
        return []
    contradiction = contradicting_runs(data)
    return [contradiction.finding] if contradiction else []


def in_true_time(data: DataSet, estimator: Estimator) -> tuple[DataSet, Mapping[str, float]]:
    """Return logs with their clock, or omega, right, and what values would be in the other time.

    Where all sines run off their omega by one share, the clock is wrong or omega is. Known masses
    decide which: their inertia goes with the square of time. Where they do not, the intervals hold
    both answers.
    """
    share = clock_error(data.sines)
    if not share:
        return data, {}
    slow, wrong = [Finding(kind, ("p1",), number=share) for kind in _CORRECTED]
    either = [
        data.corrected(lambda log: log.timed(1 + share), slow),
        data.corrected(lambda log: log.tuned(1 + share), wrong),
    ]
    answers = [(candidate, _finite(estimator(candidate))) for candidate in either]
    fits = (
        candidate.simulations.fits(estimate, candidate.counted) for candidate, estimate in answers
    )
    errors = [np.mean((1 - fit / 100) ** 2) for fit in fits]  # of the squared motion
    near = [
        answer
        for answer, error in zip(answers, errors, strict=True)
        if _NEARLY * error <= min(errors)
    ]
    (best, estimate), *others = sorted(near, key=lambda answer: _MIMICS in answer[1].names)
    if not others or (_MIMICS in others[0][1].names) > (_MIMICS in estimate.names):
        return best, {}
    unsure = Finding(FindingKind.CLOCK, ("p1",), number=share)
    return replace(best, correction=unsure), others[0][1].named


def with_other(estimate: Estimate, other: Mapping[str, float]) -> Estimate:
    """Return an estimate whose limits include other values, by name, if there are any."""
    if not other:
        return estimate
    values = np.array([other.get(name, value) for name, value in estimate.named.items()])
    return estimate.with_evidence(Rival(values, predicts=False))


def _finite(estimate: Estimate) -> Estimate:
    """Return an estimate; IdentifiabilityError if its values are no numbers.

    A p4 that is none is, where nothing drives.
    """
    wrong = [n for n, value in estimate.named.items() if not math.isfinite(value) and n != "p4"]
    if wrong:
        raise IdentifiabilityError(f"the equations of these logs give no finite {', '.join(wrong)}")
    return estimate


@contextmanager
def _explained(data: DataSet, estimator: Estimator) -> Iterator[None]:
    """Refuse logs with the name of the mistake that explains why they give no estimate."""
    if clock := find_slow_clock(data):
        step = f"a mean step of {data.logs[0].mean_step:.3g} s"
        raise with_unit_errors(InputError(data.name, "time", step, "seconds"), clock)
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            yield
    except (ButterflyError, np.linalg.LinAlgError) as error:
        unsolved = f"the equations of these logs have no solution ({error})"
        refusal: ButterflyError = IdentifiabilityError(unsolved)
        if isinstance(error, ButterflyError):
            refusal = error
        errors = find_unit_errors(data, estimator)
        better = [] if errors else _better_method(data, estimator)
        if better and isinstance(refusal, IdentifiabilityError):
            refusal = IdentifiabilityError(f"{refusal}. {BETTER_METHOD.format(*better)}")
        raise with_unit_errors(refusal, errors) from None


@_UNWARNED
def simulated(
    data: DataSet,
    estimate: Estimate,
    *,
    against: Mapping[str, LumpedParameters] = MappingProxyType({}),
    track: Track = untracked,
) -> Identified:
    """Simulate the logs of a data set with an estimate, and others; InputError if unusable."""
    estimate = data.simulations.with_horizon(estimate)
    horizon = data.simulations.horizon(estimate)
    runs = _runs(data, estimate, track)
    others = [
        try_parameters(name, parameters, data, horizon=horizon)
        for name, parameters in against.items()
    ]
    held = () if data.test_logs is None else _runs(data.test_logs, estimate)
    looped = [run for run in (*runs, *held) if run.log.closed]
    opened = [run for part in (data, data.test_logs) if part for run in _opened(part, estimate)]
    manifest = data.whole.manifest
    return Identified(
        estimate=estimate,
        estimator=estimate.method,
        origin=data.about | {"manifest": manifest and manifest.model_dump(mode="json")},
        fits={run.log.name: run.fit for run in runs},
        velocity_fits={run.log.name: run.velocity_fit for run in runs},
        held_out={run.log.name: run.fit for run in held},
        mean_errors={
            run.log.name: float(np.mean(np.abs(run.simulated - run.log.measured))) for run in looped
        },
        open_loop_fits={run.log.name: run.fit for run in opened},
        zeros={
            log.name: data.simulations.setting(number, estimate).zero
            for number, log in enumerate(data.logs)
            if data.hangs
        },
        logs=data,
        runs=runs,
        whole=WholeRuns.of(
            [(log, data.simulations.setting(k, estimate)) for k, log in enumerate(data.logs)]
        ),
        comparisons=tuple(others),
    )


def _runs(data: DataSet, estimate: Estimate, track: Track = untracked) -> tuple[FreeRun, ...]:
    numbers = track(range(len(data.logs)), "Simulating logs")
    return tuple(data.simulations.run(number, estimate) for number in numbers)


def _opened(data: DataSet, estimate: Estimate) -> list[FreeRun]:
    """Simulate the logs of servos by their drives alone, recorded or rebuilt."""
    runs = []
    for number, log in enumerate(data.logs):
        if not log.closed:
            continue
        setting = data.simulations.setting(number, estimate)
        alone = driven_alone(log, setting.parameters)
        if log.rebuilt:  # of set-points that arrived late
            setting = replace(setting, parameters=replace(setting.parameters, delay=0.0))
        runs.append(FreeRun.of(alone, setting))
    return runs
