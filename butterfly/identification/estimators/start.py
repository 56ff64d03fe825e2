"""Where iterations start, where descents from there end, and the best of these ends.

First guesses are the weak form's parameters, and rest angles of the encoder; those of a servo in
its loop come from short segments, driven by its drive alone: in the loop a joint's friction decides
where it stops, and descents from far end at other stops.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from butterfly.arrays import ROUNDING, Samples
from butterfly.errors import ButterflyError, IdentifiabilityError
from butterfly.identification.chosen_terms import TRIAL, offered_rows
from butterfly.identification.data import DataSet
from butterfly.identification.estimators.weak_form import WeakForm
from butterfly.identification.fit import MOST, PASSES, Fit
from butterfly.identification.free_run import LEAST_FIT, FreeRun, Setting
from butterfly.identification.linearisation import Linearisation, scaled_least_squares
from butterfly.identification.problem import Problem, Start
from butterfly.identification.segments import driven_alone
from butterfly.identification.stagewise import PROMISED, candidates
from butterfly.identification.test_functions import HALF_WIDTH, half_width_of
from butterfly.identification.trust import LOST, MATTERS, SHOWS, Finding, FindingKind
from butterfly.identification.weak_regression import WeakFit, near, reading_of
from butterfly.logs.log import Log
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.prior import Known, Prior, usable
from butterfly.model.terms import (
    COMMON,
    GEAR,
    GROWING,
    LOOP_TERMS,
    OF_ANGLE,
    OF_GRAVITY,
    OF_SERVO,
    offered,
)
from butterfly.progress import out_of_time

_ELSEWHERE = 1.05  # ratio of costs, above which two ends are not the same
_PASSES = 4  # of a descent at another delay, or one that is given up if not lower than another
_SAME_DELAY = 0.01  # of a sampling interval, between delays that are tried
_SAME_GRID = 0.1  # of a sampling interval, between delays of which grids are the same
_GRIDS = 2  # that a fit may need, as another one moves the delay
_PARABOLAS = 2  # how often a delay is sought at the vertex of the last ones
_RATIOS = Prior.of({"p4": 1.0})
_AT_ONCE = Prior.of({"delay": 0.0})
_GEAR = 0.1  # of each of a gear's torques that friction takes, from where on it is sought


def starts(data: DataSet, terms: tuple[str, ...] | None) -> list[Start]:
    """Return first guesses by the weak form: with all common terms and without, if none are given.

    With few logs many terms may be far off. Given terms are also left out if no log is followed, as
    with a friction that holds the joint. Without a result, the scale is guessed; ButterflyError if
    that fails too.
    """
    guesses: list[Start] = []
    refusals: list[ButterflyError] = []
    common = candidates(COMMON, data.masses, data.known)
    for some in dict.fromkeys((common if terms is None else terms, ())):
        try:
            start = _of_weak_form(data, some, turned=bool(some) or terms is not None)
        except ButterflyError as refusal:
            refusals.append(refusal)
            continue
        guesses.append(start)
        if terms is not None and _follows(data, start):
            break
    if not guesses:
        guess = None if data.known.scale() else _of_ratios(data)
        if guess is None:
            raise refusals[-1]
        guesses.append(guess)
    return guesses


def _least_inertia(start: Start, data: DataSet) -> float:
    """Return the inertia of a first guess with the least of the added masses."""
    return start.parameters.p1 + min(mass.inertia for mass in data.masses)


def _runs(data: DataSet, start: Start) -> Iterator[FreeRun]:
    """Yield free runs of logs, thinned, with a first guess."""
    for log in data.glance:
        zero = reading_of(log, start.zeros)
        yield FreeRun.of(log, Setting(parameters=start.parameters, zero=zero))


def _follows(data: DataSet, start: Start) -> bool:
    """Whether free runs of a first guess follow the logs; servos have a start of their own."""
    if any(log.closed for log in data.logs):
        return True
    with np.errstate(all="ignore"):
        return bool(np.median([run.fit for run in _runs(data, start)]) >= LEAST_FIT)


def _without_inertia(data: DataSet, inertia: float) -> ButterflyError:
    values = ", ".join(f"{name} = {value:g}" for name, value in data.known.fixed.items() if value)
    clause = f" and the known values ({values})" if values else ""
    return IdentifiabilityError(
        f"no joint explains these angles with this input{clause}: its inertia would be "
        f"{inertia:.3g}, which must be positive. Check that both come from one recording, and that "
        "nothing but the input moves the joint"
    )


def _of_weak_form(data: DataSet, terms: tuple[str, ...], *, turned: bool) -> Start:
    """Fit the weak form over windows of the logs' own time, or short ones if runs follow better.

    Long ones hide a fast motion beside a slow one. IdentifiabilityError if it finds no inertia.
    ``turned``: whether an offset of gravity corrects rest angles that nobody has given.
    """
    turned = turned and bool(data.unread)
    start = _over_windows(data, terms, None, turned=turned)
    closed = any(log.closed for log in data.glance)
    if not closed and any(half_width_of(log) > HALF_WIDTH for log in data.glance):
        with suppress(ButterflyError):
            short = _over_windows(data, terms, HALF_WIDTH, turned=turned)
            start = max(start, short, key=partial(_velocity_fit, data))
    inertia = _least_inertia(start, data)
    if not inertia > 0:
        raise _without_inertia(data, inertia)
    return start


def _velocity_fit(data: DataSet, start: Start) -> float:
    """Return the median FIT in per cent of the velocity of whole runs of a first guess."""
    if not _least_inertia(start, data) > 0:
        return -math.inf
    with np.errstate(all="ignore"):
        return float(np.median([run.velocity_fit for run in _runs(data, start)]))


def _over_windows(
    data: DataSet, terms: tuple[str, ...], half_width: float | None, *, turned: bool
) -> Start:
    """Fit the weak form (see `_of_weak_form`).

    Slow motion lags by inertia and by delay alike: an inertia below 0 is fitted again without one.
    """
    zeros = data.equilibria
    asked = {*terms, *(("p3_offset",) if turned else ())}
    wanted = tuple(name for name in offered(WeakForm.method) if name in asked)
    closed_form = WeakForm(terms=wanted, half_width=half_width)
    known = usable(closed_form.method, data.known)
    fit = closed_form.through_instruments(data.glance, zeros, known)
    if fit.values["p1"] + min(mass.inertia for mass in data.masses) <= 0 and "delay" in fit.names:
        fit = closed_form.through_instruments(data.glance, zeros, known | _AT_ONCE)
    fit.solved.independent.conditioning.require()
    parameters = _moving(fit, data)
    return _hung(Start(parameters, zeros)) if turned else Start(parameters, zeros)


def _hung(start: Start) -> Start:
    """Return a first guess with its offset of gravity expressed by its rest angles."""
    loaded = {mass: start.parameters.with_added_mass(mass) for mass in start.zeros}
    turned = {mass: math.atan2(joint.p3_offset, joint.p3) for mass, joint in loaded.items()}
    lightest = loaded[min(loaded)]
    p3 = start.parameters.p3 + math.hypot(lightest.p3, lightest.p3_offset) - lightest.p3
    zeros = {mass: zero - turned[mass] for mass, zero in start.zeros.items()}
    return Start(replace(start.parameters, p3=p3, p3_offset=0.0), zeros)


def _half_widths(fit: WeakFit) -> dict[str, float]:
    """Return the half-widths of a closed form's intervals by name."""
    return dict(zip(fit.solved.names, fit.solved.half_widths.tolist(), strict=True))


def _moving(fit: WeakFit, data: DataSet) -> LumpedParameters:
    """Return the parameters of a fit, its inertia made positive if its interval allows that."""
    parameters, least = fit.parameters, min(mass.inertia for mass in data.masses)
    if parameters.p1 + least > 0 or "p1" not in fit.names or not data.known.scale():
        return parameters
    most = parameters.p1 + _half_widths(fit)["p1"] + least
    if not most > 0:
        return parameters
    settling = parameters.p2 * min(log.mean_step for log in data.logs)
    return replace(parameters, p1=min(most / 2, settling or most) - least)


def _of_ratios(data: DataSet) -> Start | None:
    """Scale the ratios to p4 that each added mass gives, by what the masses add to p1 and p3.

    With ratios a and b of a mass, p1 + its inertia = p4 a, p3 + its gravity moment = p4 b: least
    squares by the half-widths of the ratios. Masses too small for that leave a guess.
    """
    rows, zeros = list[Samples](), dict[AddedMass, float]()
    best_ratios, best = dict[str, float](), math.inf
    for mass, zero in data.equilibria.items():
        bare = replace(mass, mass=0.0, arm=0.0)
        logs = [replace(log, added_mass=bare) for log in data.logs if log.added_mass == mass]
        try:
            fit = WeakForm(terms=("p3_offset",)).through_instruments(
                logs, {bare: zero}, data.known | _RATIOS
            )
            fit.solved.independent.conditioning.require()
        except ButterflyError:
            continue
        errors, named = _half_widths(fit), fit.solved.named
        ratios = {**named, "p3_offset": 0.0}  # which turns the zero
        zeros[mass] = zero - math.atan2(fit.parameters.p3_offset, fit.parameters.p3)
        for name, load in (("p1", mass.inertia), ("p3", mass.gravity_moment)):
            if errors.get(name, 0.0) > 0:
                row = np.array([-(name == "p1"), -(name == "p3"), named[name], load])
                rows.append(row / errors[name])
        if 0 < errors.get("p1", 0.0) < best * abs(named["p1"]):
            best_ratios, best = ratios, errors["p1"] / abs(named["p1"])
    if not best_ratios:
        return None
    *scaled, loads = np.array(rows).T
    p1, p3, p4 = scaled_least_squares(np.column_stack(scaled), loads).tolist()
    least, largest = (limit(mass.inertia for mass in data.masses) for limit in (min, max))
    if not (p1 + least > 0 and p4 * best_ratios["p1"] > 0):
        p4 = largest / best_ratios["p1"]
        p1, p3 = largest, p4 * best_ratios.get("p3", 0.0)
    if not p4:
        return None
    guess = {name: p4 * ratio for name, ratio in best_ratios.items() if name in GROWING}
    guess |= {"p1": p1, "p3": p3, "p4": p4, "delay": best_ratios.get("delay", 0.0)}
    return Start(LumpedParameters(**guess), data.equilibria | zeros)


def best_local_minimum(problems: Sequence[Problem], enough: float = ROUNDING) -> tuple[int, Fit]:
    """Return the end of a descent from the first guess whose free runs are nearest, and its number.

    From the others only where more than the noise of the sensors is left; ``enough``: of a step.
    """
    begun = [(k, trial, trial.equations(trial.initial)) for k, trial in enumerate(problems)]
    begun.sort(key=lambda row: row[2].cost if row[2].is_finite else math.inf)
    (place, problem, at), *others = begun
    end = problem.descend(at, enough=enough)
    costs = [end.cost] if end.converged else []
    for number, other, at in (
        [] if end.converged and residuals_are_white(end.linearisation) else others
    ):
        if not at.is_finite or out_of_time("fits from other initial guesses"):
            break
        with suppress(IdentifiabilityError):
            tried = other.descend(at, _PASSES, enough)
            if not tried.converged and tried.cost < end.cost:
                tried = other.descend(tried.linearisation, enough=enough)
            costs += [tried.cost] if tried.converged else []
            if tried.cost < end.cost:
                place, end = number, tried
    elsewhere = [ratio for ratio in (cost / end.cost for cost in costs) if ratio > _ELSEWHERE]
    findings = tuple(Finding(FindingKind.OTHER_END, number=min(elsewhere)) for _ in elsewhere[:1])
    return place, replace(end, findings=findings)


def with_zero_at_rest_angle(every: Problem, fit: Fit) -> Fit:
    """Return the same fit, the encoder's zero where a joint without added masses hangs.

    Half a turn of the zero and the other sign of gravity are the same motion.
    """
    problem, values = every.of_fit(fit), fit.values.copy()
    at = {name: k for k, (name, whose) in enumerate(problem.keys) if whose is None}
    turns = {"p3", "zero"} <= at.keys() and not (OF_ANGLE - {*OF_GRAVITY}) & at.keys()
    if any(log.added_mass.mass for log in problem.logs) or not turns or values[at["p3"]] >= 0:
        return fit
    for name in at.keys() & {*OF_GRAVITY}:
        values[at[name]] *= -1
    home = float(np.median(problem.logs[0].angle))
    values[at["zero"]] = near(values[at["zero"]] + math.pi, home)
    turned = problem.descend(problem.equations(values, fit.linearisation))
    return replace(turned, findings=fit.findings)


def on_its_grid(every: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """Return a problem whose logs begin on their grids by the delay of a fit, and the fit to them.

    A grid begins before its log by a delay. Where that is another one, the joint begins to move at
    another instant: by what it is late, times its pace, all that follows a start at rest is wrong.
    """
    recorded = [log for log in every.logs if not log.closed]
    for _ in range(_GRIDS if recorded and "delay" in fit.named else 0):
        later = fit.named["delay"] - every.start.delay
        if abs(later) <= _SAME_GRID * min(log.mean_step for log in recorded):
            break
        every = every.of_logs(every.logs, later)
        problem = every.of_fit(fit)
        with suppress(IdentifiabilityError):
            end = problem.descend(problem.equations(fit.values, fit.linearisation))
            fit = replace(
                fit,
                linearisation=end.linearisation,
                ending=end.ending,
                unsettled=end.unsettled,
                bread=end.bread,
            )
    return every, fit


def begun_anew(every: Problem, fit: Fit, rows: Sequence[str], rare: Collection[str]) -> Fit:
    """Return a fit that begins with all common terms, if the first is poor.

    Where few terms follow no log, their values are those of no joint, about which others can
    neither be found nor refused; the closed form has values for all.
    """
    poor = 2 * fit.cost > LOST**2 * len(every.motion)
    if not (rows and poor) or out_of_time("a fit that begins with all common terms"):
        return fit
    common = every.without([*rare])
    with suppress(IdentifiabilityError):
        at = common.equations(common.initial)
        end = common.descend(at, TRIAL, SHOWS, TRIAL * at.steps)
        if end.cost < PROMISED * fit.cost:
            return replace(end, findings=fit.findings)
    return fit


def refitted(problem: Problem, values: Samples, near: Linearisation | None = None) -> Fit | None:
    """Return the end of a short descent from (n,) values; None if no joint moves so."""
    try:
        return problem.descend(problem.equations(values, near), PASSES, SHOWS)
    except IdentifiabilityError:
        return None


def residuals_are_white(at: Linearisation) -> bool:
    """Whether errors are a small share of the motion, and white by their second differences."""
    return 2 * at.cost <= at.ends.size * MATTERS**2 and at.cost <= _ELSEWHERE * at.white_cost


ProblemOf = Callable[[Sequence[Log], Start, Prior], Problem]
"""Makes the residuals of logs from a first guess and what is known."""


def servo_start(
    over: Callable[[Iterable[str], Iterable[str], float], ProblemOf],
    asked: tuple[Sequence[str] | None, Sequence[str]],
    logs: Sequence[Log],
    guess: Start,
    known: Prior,
) -> Start:
    """Return a first guess of servos, whose friction decides where they stop.

    Over segments of one period, or a few time constants of the speed, driven by the rebuilt drive,
    no stop is far off. ``over`` makes the problem with some terms, with what is fixed, over a
    horizon in s; ``asked`` are the terms, None to choose them, and what is fixed.
    """
    wanted, fixed = asked
    loaded = [guess.parameters.with_added_mass(log.added_mass) for log in logs]
    fastest = max(max(resonance_frequency(joint), joint.p2 / joint.p1) for joint in loaded)
    gear = {*GEAR} & {*(OF_SERVO if wanted is None else wanted)}
    begun = dict.fromkeys(gear - known.parameters.keys(), _GEAR)
    start = replace(guess, parameters=replace(guess.parameters, **begun))
    rows, rare = offered_rows(logs, known)
    terms = [name for name in rows if name not in rare] if wanted is None else wanted
    horizon = 2 * math.pi / fastest if fastest > 0 else math.inf
    problem_of = over(terms, {"delay", *fixed, *LOOP_TERMS}, horizon)
    scanned = "delay" not in {*known.fixed, *fixed}
    delay = 0.0 if scanned else known.fixed.get("delay", guess.parameters.delay)
    known = known | Prior({"delay": Known(value=0.0)})  # of the drive itself
    ends: list[tuple[float, float, Problem, Fit]] = []

    def attempt(delay: float) -> None:
        late = replace(start.parameters, delay=delay)
        begun = replace(start, parameters=replace(late, delay=0.0))
        problem = problem_of([driven_alone(log, late) for log in logs], begun, known)
        if ends:
            best = ends[0][3]
            end = problem.descend(problem.equations(best.values, best.linearisation), _PASSES)
        else:
            end = problem.descend()
        ends.append((end.cost, delay, problem, end))
        ends.sort(key=lambda row: row[:2])

    attempt(delay)
    if scanned and any(log.rebuilt for log in logs):
        step = float(np.median([log.mean_step for log in logs]))
        while ends[0][1] == max(row[1] for row in ends) and len(ends) < MOST:
            attempt(ends[0][1] + step)
        if ends[0][1] == 0.0:
            attempt(step / 2)
        for _ in range(_PARABOLAS):
            costs, delays = np.array([row[:2] for row in ends[:3]]).T / [[ends[0][0]], [step]]
            bend, slope, _ = np.linalg.solve(np.vander(delays, 3), costs).tolist()
            lowest = max(-slope / (2 * bend), 0.0) if bend > 0 else delays[0]
            if np.abs(delays - lowest).min() < _SAME_DELAY:
                break
            attempt(lowest * step)
    _, delay, problem, end = ends[0]
    first = problem.start_at(end.values)
    first = _hung(first) if "zero" in problem.names else first
    return replace(first, parameters=replace(first.parameters, delay=delay))
