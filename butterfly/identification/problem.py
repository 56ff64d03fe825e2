"""Logs to be fitted by free runs, and the unknowns with which they are simulated.

An unknown belongs to all logs, to those with one added mass, or to one log.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import ROUNDING, Samples
from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.fit import CONVERGED, MOST, PASSES, Box, Fit, minimise
from butterfly.identification.limits import cells_of, independent_cells_of
from butterfly.identification.linearisation import Linearisation, scaled_least_squares
from butterfly.identification.loss import Loss
from butterfly.identification.scatter import Scatter
from butterfly.identification.segments import FINEST
from butterfly.identification.simulation import Simulation, segment_length
from butterfly.identification.trust import Ending
from butterfly.identification.weak_regression import reading_of
from butterfly.logs.log import Log
from butterfly.model.greybox import INITIAL
from butterfly.model.parameters import AddedMass, LumpedParameters, value_if_absent
from butterfly.model.prior import Known, Penalty, Prior
from butterfly.model.terms import FOLLOWERS, TERMS, companions, lower_bounds
from butterfly.progress import current_search, out_of_time, threads
from butterfly.signals.frequency_response import first_counted

_FOLLOWS = 0.5  # largest relative change in one step of what only another term shows

_SETTLED = 0.1  # of a sampling interval, in which a base that no log shows settles

Key = tuple[str, "AddedMass | str | None"]
"""An unknown by name, and the added mass or log that it belongs to; None: shared by all logs."""

LOCAL = ("zero", "bias", "velocity")
"""Unknowns that may be local to an added mass or to a log."""

_SIGNLESS = 0.1  # first guess of a term of unobservable sign, whose derivative is 0 at 0


@dataclass(frozen=True, eq=False)
class Start:
    """A first guess."""

    parameters: LumpedParameters  # of the bare hand
    zeros: Mapping[AddedMass, float]  # the encoder's reading in rad at rest for each added mass

    @classmethod
    def at(cls, estimate: Estimate, data: DataSet) -> Start:
        """Return the start at an estimate; its zeros are those of the logs if it has none."""
        zero = estimate.local.get(None, {}).get("zero")
        zeros = data.equilibria if zero is None else dict.fromkeys(data.masses, zero)
        return cls(estimate.parameters, zeros)


@dataclass(frozen=True, kw_only=True)
class ProblemOptions:
    """How logs are simulated, and which unknowns are local (see `estimators.OutputError`)."""

    per_mass: Sequence[str] = ()
    per_log: Sequence[str] = ()
    window: float  # s
    horizon: float  # s
    workers: int
    loss: Loss


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """Simulations of k logs, and the n unknowns that are fitted."""

    keys: tuple[Key, ...]  # the unknowns
    shared: int  # number of the first ones, which all logs share; without the encoder's zero
    start: LumpedParameters  # values of the parameters that are not fitted
    initial: Samples  # (n,) first guesses
    lower: Samples  # (n,) lower bounds
    # reading of the encoder in rad at the model's angle 0 per added mass, where it is not fitted
    zeros: Mapping[AddedMass, float]
    robot: Prior  # what is known of it
    known: Mapping[Key, Known]  # priors of the unknowns
    simulations: tuple[Simulation, ...]
    motion: tuple[float, ...]  # rms motion of each in rad
    options: ProblemOptions
    scatter: Scatter | None = None  # by which logs are weighed; None: plain logs

    @classmethod
    def of(
        cls,
        logs: Sequence[Log],
        first: Start,
        names: Sequence[str],
        options: ProblemOptions,
        known: Prior,
    ) -> Problem:
        """Return the problem of fitting logs in shared parameters, by name, and local unknowns."""
        start = replace(first.parameters, **known.fixed)
        simulations = simulations_of(logs, start, options)
        motion = tuple(_rms_motion(simulation.log, simulation.first) for simulation in simulations)
        hangs = not known.weightless(log.added_mass for log in logs)
        keys_of = {
            (simulation.log.name, name): _local_key(name, simulation, logs, options, hangs=hangs)
            for simulation in simulations
            for name in LOCAL
        }
        local = dict.fromkeys(key for key in keys_of.values() if key is not None)
        keys: tuple[Key, ...] = (*((name, None) for name in names), *local)
        least = dict(zip(names, lower_bounds(names).tolist(), strict=True)) | known.lower
        least["p1"] = _least_inertia(logs, start)
        priors: dict[Key, Known] = {(name, None): prior for name, prior in known.parameters.items()}
        for key in local:
            zeros = {log.zero for log in logs if keys_of[log.name, "zero"] == key}
            if len(zeros) == 1 and (zero := zeros.pop()) is not None:
                priors[key] = zero
        return cls(
            keys=keys,
            shared=len(names),
            start=start,
            initial=np.array([_first_guess(key, logs, start, first.zeros) for key in keys]),
            lower=np.array([least.get(name, -np.inf) for name, _ in keys]),
            zeros=first.zeros,
            robot=known,
            known=priors,
            simulations=simulations,
            motion=motion,
            options=options,
        )

    @property
    def names(self) -> tuple[str, ...]:
        """(n,) names of the unknowns."""
        return tuple(name for name, _ in self.keys)

    @property
    def labels(self) -> tuple[str, ...]:
        """(n,) names of the unknowns, with the added mass or log of local ones."""
        return labels_of(self.keys)

    def named(self, values: Samples) -> dict[str, float]:
        """Return (n,) values by label."""
        return dict(zip(self.labels, values.tolist(), strict=True))

    def start_at(self, values: Samples) -> Start:
        """Return the first guess that (n,) values are, those of single masses or logs aside."""
        keys = zip(self.keys, values.tolist(), strict=True)
        shared = {name: value for (name, whose), value in keys if whose is None}
        zeros = dict.fromkeys(self.zeros, shared.pop("zero")) if "zero" in shared else self.zeros
        return Start(replace(self.start, **shared), zeros)

    @property
    def logs(self) -> list[Log]:
        """The k logs."""
        return [simulation.log for simulation in self.simulations]

    @property
    def box(self) -> Box:
        """Bounds, and limits of steps.

        Those of `FOLLOWERS`, as without their term they are not identifiable, and that of p1, as no
        linear equation knows that the inertia with an added mass is positive.
        """
        least = min(log.added_mass.inertia for log in self.logs)
        names = np.array(self.names)
        share = np.where(np.isin(names, [*FOLLOWERS]), _FOLLOWS, np.inf)
        return Box(self.lower, share, origin=np.where(names == "p1", -least, -np.inf))

    def equations(
        self,
        values: Samples,
        near: Linearisation | None = None,
        *,
        most: float = np.inf,
        slopes: bool = True,
    ) -> Linearisation:
        """Return errors over each log's rms motion about (n,) values, or (k, n), one row per log.

        A log's squares sum to their mean, unless logs are weighed. Fitted starts are sought from
        those of the equations ``near``, and never from those of another trial. Once the cost
        exceeds ``most``, no further logs are simulated.
        """
        if self.scatter is not None:
            effects = np.maximum(self.scatter.own_of(self.labels), self.lower - values)
            at = replace(self, scatter=None).equations(values + effects, near)
            return self.scatter.weighed(at, values, effects) if at.is_finite else at
        search = current_search()
        search.simulations += 1
        of_logs = np.broadcast_to(values, (len(self.motion), len(self.keys)))
        for number, simulation in enumerate(self.simulations):
            simulation.begins = near.begins[number] if near and near.begins else simulation.recorded
        simulated, parts, cost = partial(self._of_log, slopes=slopes), [], 0.0
        several = self.options.workers > 1
        with threads(self.options.workers) if several else nullcontext() as pool:
            each_log = map if pool is None else pool.map
            for errors, rows in each_log(simulated, range(len(of_logs)), of_logs):
                parts.append((errors, rows))
                cost += 0.5 * float(errors @ errors) if most < np.inf else 0.0
                if not cost <= most or (most < np.inf and search.over):
                    break
            if pool is not None:
                pool.shutdown(cancel_futures=True)
        spent = [simulation.spend() for simulation in self.simulations]
        steps = sum(spent[: len(parts)])  # threads may have begun some of the others
        search.steps += steps
        if len(parts) < len(of_logs):
            parts.append(self._impossible)
        return replace(
            Linearisation.of_logs(parts, self.labels, of_logs[0]),
            lower=self.lower,
            steps=steps,
            begins=tuple(simulation.begins for simulation in self.simulations),
        )

    def stepped(self, values: Samples, at: Linearisation) -> Linearisation:
        """Return the equations where a step leads from others, with the loss of these.

        A higher cost ends them early.
        """
        if at.loss is Loss.LINEAR:
            return self.equations(values, at, most=at.cost)
        return replace(self.equations(values, at), loss=at.loss, scale=at.scale)

    @np.errstate(over="ignore", invalid="ignore")  # of a motion that diverges; per thread
    def _of_log(self, index: int, values: Samples, *, slopes: bool) -> tuple[Samples, Samples]:
        """(m,) errors of a log and (m, n) derivatives, over its motion."""
        simulation, log = self.simulations[index], self.simulations[index].log
        columns = columns_of(self.keys, log)
        given = {name: float(values[k]) for name, k in columns.items()}
        moved = {name: value for name, value in given.items() if name not in INITIAL}
        parameters = replace(self.start, **moved)
        if not parameters.p1 + log.added_mass.inertia > 0:
            return self._impossible
        fastest = parameters.base_frequency * max(1.0, 2 * parameters.base_damping)
        if parameters.base_compliance and _SETTLED * log.mean_step * fastest > 1:
            return self._impossible  # a base that settles within a tenth of a sampling interval
        zero = given["zero"] if "zero" in given else reading_of(log, self.zeros)
        names = list(given) if slopes else []
        errors, rows = simulation.linearised(names, parameters, zero, given.get("velocity"))
        return relative(
            errors, rows, [columns[name] for name in names], len(self.keys), self.motion[index]
        )

    @property
    def _impossible(self) -> tuple[Samples, Samples]:
        """An error of infinite cost, of impossible parameters: a descent rejects the step."""
        return np.full(1, np.inf), np.zeros((1, len(self.keys)))

    def knowing(self, at: Linearisation) -> Linearisation:
        """Return equations of errors of variance 1 with the prior."""
        return replace(at, prior=self.prior(at.values))

    def with_scaled_prior(self, at: Linearisation) -> Linearisation:
        """Return equations with the prior, scaled by the variance that the residuals realise."""
        at = self.knowing(at)
        if self.scatter or at.prior is None or not at.is_finite:
            return at
        about = at.cells(independent_cells_of(len(self.motion), len(self.keys)))
        residuals = about.residuals - about.rows @ scaled_least_squares(about.rows, about.residuals)
        free = replace(about, residuals=residuals)
        return replace(at, prior=at.prior.weighed(free.realised_variance))

    def prior(self, values: Samples) -> Penalty | None:
        """Return the prior of (n,) values, for rows of variance 1; None if nothing is known."""
        about = dict(zip(self.keys, values.tolist(), strict=True))
        return Penalty.of(self.keys, self.known, values=about)

    def descend(
        self,
        at: Linearisation | None = None,
        most: int = MOST,
        enough: float = ROUNDING,
        steps: float = np.inf,
    ) -> Fit:
        """Return the end of a descent from equations or the first guess (see `fit.minimise`)."""
        at, evaluations = (self.equations(self.initial), 1) if at is None else (at, 0)
        if self.scatter:
            return self._descend_weighed(self.with_scaled_prior(at), most, enough)
        robust = self.options.loss is not Loss.LINEAR
        for _ in range(MOST):
            before = at = self.with_scaled_prior(at)
            if at.loss is Loss.LINEAR:
                rest = most - evaluations
                end = minimise(self.stepped, at, self.box, rest, enough, steps=steps)
                evaluations, at = evaluations + end.evaluations, end.linearisation
            if robust:  # from the least squares on
                at = at if at.loss is self.options.loss else at.counting(self.options.loss)
                end = minimise(self.stepped, at, self.box, MOST, enough, steps=steps)
                evaluations, at = evaluations + end.evaluations, end.linearisation
            if not end.converged and evaluations < most:
                out_of_time("iterations of a fit that had not converged")
            if not end.converged or self.with_scaled_prior(at).prior_weighs_as(before):
                break
        return replace(end, evaluations=evaluations)

    def _descend_weighed(self, at: Linearisation, most: int, enough: float) -> Fit:
        """Return where whole steps of weighed logs lead; each log's own friction and gain follow.

        IdentifiabilityError if a simulation diverges.
        """
        scatter, tries = self.scatter, min(most, PASSES)
        while True:
            step = at.step(*self.box.about(at.values, np.inf))
            settled = at.decrease(step) <= max(enough, CONVERGED) * at.cost
            if scatter is None or settled or not tries:
                ending = Ending.CONVERGED if settled else Ending.STOPPED
                return Fit(linearisation=at.moved(step), ending=ending, scatter=scatter)
            values, tries = at.values + step, tries - 1
            effects = np.maximum(scatter.random_effects(at, step), self.lower - values)
            scatter = replace(scatter, names=self.labels, effects=effects)
            here = replace(self, scatter=scatter)
            at = here.knowing(here.equations(values, at))
            if not at.is_finite:
                raise IdentifiabilityError("a simulation of weighed logs diverges")

    def of_logs(self, logs: Sequence[Log], later: float = 0.0) -> Problem:
        """Return the problem with logs of the same motions, inputs acting ``later`` by s."""
        start = replace(self.start, delay=self.start.delay + later)
        return replace(self, start=start, simulations=simulations_of(logs, start, self.options))

    def keeping(self, indices: NDArray[np.intp], initial: Samples) -> Problem:
        """Return the problem in the unknowns with these ``indices``; the other terms are absent."""
        lost = np.delete(self.names, indices).tolist()
        absent = {name: value_if_absent(name) for name in lost}
        return replace(
            self,
            start=replace(self.start, **absent),
            keys=tuple(self.keys[k] for k in indices),
            shared=int(np.sum(indices < self.shared)),
            lower=self.lower[indices],
            initial=initial,
        )

    def without(self, names: Container[str]) -> Problem:
        """Return the nested problem without some terms and parameters that only they identify."""
        lost = {name for name in self.names if name in names}
        rest = {*self.names} - lost
        lost |= {name for name in companions(lost) if not TERMS[name].follows & rest}
        indices = np.flatnonzero([name not in lost for name in self.names])
        return self.keeping(indices, self.initial[indices])

    def values_from(self, other: Problem, values: Samples, rest: Samples | None = None) -> Samples:
        """Return (..., n) values: (..., m) of another problem's unknowns, and (n,) of the rest.

        The rest is absent if not given.
        """
        if rest is None:
            absent = [value_if_absent(name) for name in self.names]
            rest = np.where(np.isin(self.names, [*FOLLOWERS]), self.initial, absent)
        merged = np.broadcast_to(rest, (*values.shape[:-1], len(self.keys))).copy()
        both = [key for key in self.keys if key in other.keys]
        theirs = [other.keys.index(key) for key in both]
        merged[..., [self.keys.index(key) for key in both]] = values[..., theirs]
        return merged

    def of_fit(self, fit: Fit) -> Problem:
        """Return the nested problem in the values of a fit, its logs weighed as there."""
        indices = np.array([self.labels.index(name) for name in fit.linearisation.names])
        return replace(self.keeping(indices, fit.values), scatter=fit.scatter)

    def in_cells(self, fit: Fit) -> Fit:
        """Return a fit of these values with its equations in cells, for inference."""
        count = cells_of(len(self.motion), len(self.keys))
        at, plain = fit.linearisation, fit.unweighed
        cells = at.cells(count if plain is None else 1)
        return replace(
            fit,
            linearisation=cells,
            unweighed=plain and plain.cells(count),
            bread=None if at.loss is Loss.LINEAR else at.bread,
            unsettled=None if fit.converged else cells.next_step,
        )


def simulations_of(
    logs: Iterable[Log], start: LumpedParameters, options: ProblemOptions
) -> tuple[Simulation, ...]:
    """Return how logs are simulated in a fit, each from its first sample that counts."""
    known, simulations = "velocity" in {*options.per_mass, *options.per_log}, list[Simulation]()
    for log in logs:
        k = first_counted(log, options.window)
        most = options.horizon
        length = segment_length(log, start, most, first=k, velocity_known=known, free=True)
        simulations.append(Simulation(log, start, k, length, warm=True))
    return tuple(simulations)


def labels_of(keys: Iterable[Key]) -> tuple[str, ...]:
    """Return names of unknowns, with the added mass or log of local ones."""
    return tuple(name if whose is None else f"{name} of {whose}" for name, whose in keys)


def columns_of(keys: Sequence[Key], log: Log) -> dict[str, int]:
    """Return the indices of a log's unknowns by name; local ones take precedence."""
    columns: dict[str, int] = {}
    for owner in (None, log.added_mass, log.name):
        columns |= {name: k for k, (name, whose) in enumerate(keys) if whose == owner}
    if log.zero is not None and log.zero.fixed:
        columns.pop("zero", None)
    return columns


def relative(
    errors: Samples, rows: Samples, columns: Sequence[int], count: int, motion: float
) -> tuple[Samples, Samples]:
    """Return (m,) errors over an rms motion, and (m, n) derivatives by all ``count`` values.

    The ``rows`` are (m, k) derivatives by values with these numbers, scaled in place, as are the
    errors; squares sum to a mean.
    """
    unit = 1 / (motion * errors.size**0.5)
    every = rows
    if [*columns] != [*range(count)]:
        every = np.zeros((errors.size, count))
        every[:, [*columns]] = rows
    every *= unit
    errors *= unit
    return errors, every


def _local_key(
    name: str, simulation: Simulation, logs: Sequence[Log], options: ProblemOptions, *, hangs: bool
) -> Key | None:
    """Return the key of a log's zero, bias or velocity; None where it is not fitted."""
    log = simulation.log
    exact = name == "zero" and log.zero is not None and log.zero.fixed
    if exact or (name == "velocity" and simulation.fitted):
        return None
    if name in options.per_log:
        return name, log.name
    if name in options.per_mass:
        return name, log.added_mass
    if name != "zero" or not hangs:
        return None
    open_ = [other for other in logs if other.zero is None or not other.zero.fixed]
    if log.zero is None or len({other.zero for other in open_}) == 1:
        return name, None
    of_mass = {other.zero for other in open_ if other.added_mass == log.added_mass}
    return name, log.added_mass if len(of_mass) == 1 else log.name


def _least_inertia(logs: Sequence[Log], start: LumpedParameters) -> float:
    """Return the lower bound of p1: the speed settles in 1/`FINEST` of a sampling interval."""
    carried = min(log.added_mass.inertia for log in logs)
    settled = start.p2 * min(log.mean_step for log in logs) / FINEST
    return max(settled, ROUNDING * (start.p1 + carried)) - carried


def _rms_motion(log: Log, first: int) -> float:
    """Return the rms motion of a log's measured signal from the sample numbered ``first`` on."""
    motion = float(np.std(log.measured[first:])) if first < log.angle.size else 0.0
    if not motion > ROUNDING:
        text = f"{motion:.1g} {log.unit} rms motion in the samples that are fitted"
        raise InputError(log.source, log.measures, text, "a moving joint: exclude this log")
    return motion


def _first_guess(
    key: Key, logs: Sequence[Log], start: LumpedParameters, zeros: Mapping[AddedMass, float]
) -> float:
    name, whose = key
    if name == "zero":
        masses = {log.added_mass for log in logs if whose in {None, log.added_mass, log.name}}
        return float(np.median([zeros[mass] for mass in masses]))
    guess = float(getattr(start, name, 0.0))
    signless = guess == 0 and name in TERMS and not TERMS[name].sign_observable
    return _SIGNLESS if signless else guess
