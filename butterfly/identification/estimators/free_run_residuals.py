"""The residuals of output error: all logs simulated freely, their parameters of several owners."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.identification.blocks import Conditions, cells_of, independent_cells_of
from butterfly.identification.encoder_offset import reading_of
from butterfly.identification.equations import CellEquations, scaled_least_squares
from butterfly.identification.estimators.gauss_newton import (
    Equations,
    LogEquations,
    Loss,
    Minimum,
    minimise_robustly,
)
from butterfly.identification.estimators.local_parameters import (
    Key,
    columns_of,
    known_zeros,
    local_keys,
)
from butterfly.identification.inference.agreement import lacking_term
from butterfly.identification.inference.covariance import cluster_covariance
from butterfly.identification.inference.identifiability import SINGULAR_CONDITION, Conditioning
from butterfly.identification.inference.term_choice import (
    BASE,
    CANDIDATES,
    RARER,
    SCANNED,
    TermChoice,
    choose_terms,
    submodels_of,
)
from butterfly.identification.levels import FEW, MOST, PRECISE, ROUNDING, SPREADS
from butterfly.identification.segments import Segments, is_segmented
from butterfly.identification.simulation import FINEST, Simulation
from butterfly.logs.log import InputKind, Log
from butterfly.model.greybox import INITIAL
from butterfly.model.parameters import AddedMass, LumpedParameters
from butterfly.model.prior import Known, Penalty, Prior
from butterfly.model.terms import TERMS, companions, lower_bounds, offered
from butterfly.progress import current_search, out_of_time, threads
from butterfly.signals.frequency_response import first_counted

TRIED = (*CANDIDATES, *companions({SCANNED}))
"""Terms that are tried where none are told."""

OF_SERVO = ("motor_friction", "load_friction", "back_emf", "compression", "latency")
"""Terms that are tried besides of a servo, which has a gear and can be switched off."""


def tried(logs: Iterable[Log]) -> tuple[str, ...]:
    """Return the terms that are tried where none are told; no back EMF of a torque drive."""
    kinds = {log.input_kind for log in logs if log.setpoint is not None}
    if not kinds:
        return TRIED
    against = {"back_emf"} if kinds <= {InputKind.CURRENT, InputKind.TORQUE} else set()
    return (*TRIED, *(name for name in OF_SERVO if name not in against))


LOCAL = ("zero", "bias", "velocity")
"""What may differ from mass to mass or from log to log."""

_PHASES = np.linspace(0, 2 * np.pi, 401)  # reversals among them, where Stribeck friction acts


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeRunResiduals:
    """Residuals of a set of logs and their derivatives, in parameters scaled to be of order 1."""

    start: LumpedParameters  # values of the parameters that are not fitted
    keys: tuple[Key, ...]  # the n parameters, and whose each is
    shared: int  # how many of them, the first ones, all logs share, the encoder's zero aside
    # scale, lower, initial: (n,) sizes, and least values and first guesses in units of them
    scale: Samples
    lower: Samples
    initial: Samples
    # reading of the encoder in rad at the model's angle 0 per added mass, where it is not fitted
    zeros: Mapping[AddedMass, float]
    known: Mapping[Key, Known]  # what is known of parameters and zeros
    simulations: tuple[Simulation | Segments, ...]
    motion: tuple[float, ...]  # rms motion of each in rad
    workers: int
    loss: Loss

    @classmethod
    def of(
        cls,
        logs: Sequence[Log],
        start: LumpedParameters,
        zeros: Mapping[AddedMass, float],
        *,
        shared: Sequence[str],
        per_mass: Sequence[str],
        per_log: Sequence[str],
        window: float,
        horizon: float,
        workers: int,
        loss: Loss,
        known: Prior,
    ) -> FreeRunResiduals:
        """Make logs ready to be fitted."""
        start = replace(start, **known.fixed)
        first = [first_counted(log, window) for log in logs]
        motion = tuple(_rms_motion(log, k) for log, k in zip(logs, first, strict=True))
        own, few = "velocity" in {*per_mass, *per_log}, len(logs) <= FEW
        simulations = tuple(
            Segments(log, start, horizon, k, warm=True)
            if is_segmented(log, start, horizon, first=k, velocity_known=own, free=few)
            else Simulation(log, start, k)
            for log, k in zip(logs, first, strict=True)
        )
        hangs = not known.weightless(log.added_mass for log in logs)
        anchored = [each.log for each in simulations if not isinstance(each, Segments)]
        owned = local_keys(logs, per_mass, per_log, hangs=hangs, anchored=anchored)
        keys = (*((name, None) for name in shared), *owned)
        sizes = _scales(logs, start)
        scale = np.array([sizes[name] for name, _ in keys])
        names = [name for name, _ in keys]
        least = dict(zip(names, lower_bounds(names).tolist(), strict=True)) | known.lower
        least["p1"] = _least_inertia(logs, start)
        guesses = [_first_guess(key, logs, start, zeros, sizes) for key in keys]
        told: dict[Key, Known] = {(name, None): each for name, each in known.parameters.items()}
        return cls(
            start=start,
            keys=keys,
            shared=len(shared),
            scale=scale,
            lower=np.array([least[name] for name, _ in keys]) / scale,
            initial=np.array(guesses) / scale,
            zeros=zeros,
            known={**told, **known_zeros(keys, logs)},
            simulations=simulations,
            motion=motion,
            workers=workers,
            loss=loss,
        )

    @property
    def names(self) -> tuple[str, ...]:
        """(n,) names of the parameters."""
        return tuple(name for name, _ in self.keys)

    @property
    def labels(self) -> tuple[str, ...]:
        """(n,) what the parameters are called, and of whom."""
        return tuple(name if whose is None else f"{name} of {whose}" for name, whose in self.keys)

    def equations(self, scaled: Samples, most: float = np.inf, *, slopes: bool = True) -> Equations:
        """Return errors relative to each log's rms motion about (n,) values, or (k, n) of k logs.

        A log's squares sum to their mean. Logs beyond a cost of ``most`` are not simulated.
        """
        values = np.broadcast_to(scaled, (len(self.motion), len(self.keys))) * self.scale
        segmented = [each for each in self.simulations if isinstance(each, Segments)]
        begins = [each.begins for each in segmented]
        simulated = partial(self._of_log, slopes=slopes)
        if self.workers == 1:
            found = self._within(most, map(simulated, range(len(values)), values))
        else:
            with threads(self.workers) as pool:
                found = self._within(most, pool.map(simulated, range(len(values)), values))
                pool.shutdown(cancel_futures=True)
        if len(found) < len(values):  # whichever were simulated, they begin where they did
            for each, own in zip(segmented, begins, strict=True):
                each.begins = own
            found.append(_impossible(len(self.keys)))
        return Equations(logs=tuple(found))

    def _within(self, most: float, logs: Iterable[LogEquations]) -> list[LogEquations]:
        """Return the equations of the first logs, until they cost too much, or the time is over."""
        found: list[LogEquations] = []
        cost, search = 0.0, current_search()
        for each in logs:
            found.append(each)
            cost += 0.5 * float(each.residuals @ each.residuals) if most < np.inf else 0.0
            if not cost <= most or (most < np.inf and search.over):
                break
        return found

    def weighed(self, at: Equations, point: Samples) -> Equations:
        """Return equations about (n,) scaled values beside what is known of these."""
        prior = self.prior(point)
        if prior is None or not at.is_finite:
            return at
        cells = independent_cells_of(len(at.logs), len(self.keys))
        about = self.about_point(point, replace(at, known=(prior, point)), cells)
        rows = about.rows.reshape(-1, point.size)
        left = about.residuals.ravel() - rows @ scaled_least_squares(rows, about.residuals.ravel())
        free = replace(about, residuals=left.reshape(about.residuals.shape))
        return replace(at, known=(prior.weighed(free.realised_variance), point))

    def prior(self, point: Samples) -> Penalty | None:
        """Return what is known of (n,) scaled values, beside rows of variance 1."""
        values = dict(zip(self.keys, (point * self.scale).tolist(), strict=True))
        prior = Penalty.of(self.keys, self.known, values=values)
        return prior and prior.turned(1 / self.scale, np.zeros(point.size))

    def keeping(self, kept: NDArray[np.intp], initial: Samples) -> FreeRunResiduals:
        """Return the residuals in some of the parameters; terms that are not kept are absent."""
        lost = np.delete(self.names, kept).tolist()
        absent = {name: getattr(LumpedParameters, name, 0.0) for name in lost}
        return replace(
            self,
            start=replace(self.start, **absent),
            keys=tuple(self.keys[k] for k in kept),
            shared=int(np.sum(kept < self.shared)),
            scale=self.scale[kept],
            lower=self.lower[kept],
            initial=initial,
        )

    def descend(
        self, initial: Samples, known: Equations | None = None, most: int = MOST
    ) -> Minimum:
        """Return where a descent from (n,) scaled values ends (see `gauss_newton.minimise`)."""
        at, evaluations = (self.equations(initial), 1) if known is None else (known, 0)
        for _ in range(MOST):
            at = self.weighed(at, initial)
            end = minimise_robustly(
                self.equations, initial, self.lower, self.loss, known=at, most=most - evaluations
            )
            evaluations += end.evaluations
            initial, before, at = end.point, at, end.at
            if not end.converged and evaluations < most:
                out_of_time("iterations of a fit that had not converged")
            if not end.converged or self.weighed(at, initial).weigh_as(before):
                break
        return replace(end, evaluations=evaluations)

    def choose_terms(self, point: Samples, at: Equations, always: Sequence[str]) -> TermChoice:
        """Choose the terms that help to predict the free runs of logs left out."""
        logs = [each.log for each in self.simulations]
        every = {*tried(logs), *RARER}
        optional = every.difference(always) | companions(every)
        masses = [log.added_mass for log in logs]
        cells = independent_cells_of(len(logs), len(self.keys))
        conditions = Conditions.of(logs, cells)
        nested = submodels_of(self.about_point(point, at, cells), masses, conditions=conditions)
        kept = tuple(label for label in self.labels if label not in optional)
        return choose_terms([nested], always=kept)

    def fitted(self, choice: TermChoice) -> tuple[FreeRunResiduals, Minimum, tuple[Samples, ...]]:
        """Return the residuals in what was chosen, where their descent ends, and the rivals."""
        wanted = {*choice.names, *companions(choice.names)}
        names = [label for label in self.labels if label in wanted]
        here = dict(zip(self.labels, self.initial.tolist(), strict=True))
        first, *others = (
            np.array([values.get(name, here[name]) for name in names])
            for values in (choice.values, *choice.rivals)
        )
        problem = self.keeping(np.flatnonzero([label in names for label in self.labels]), first)
        rivals = tuple((each * problem.scale)[: problem.shared] for each in others)
        return problem, problem.descend(first), rivals

    def without(self, names: Container[str]) -> FreeRunResiduals:
        """Return the residuals without some terms, and what says nothing without them."""
        lost = {name for name in self.names if name in names}
        left = {*self.names} - lost
        lost |= {name for name in companions(lost) if not TERMS[name].follows & left}
        kept = np.flatnonzero([name not in lost for name in self.names])
        return self.keeping(kept, self.initial[kept])

    def about(self, problem: FreeRunResiduals, point: Samples) -> tuple[Samples, Equations]:
        """Return (n,) scaled values, and the equations about them, at those of fewer parameters."""
        values = self.values_of(problem, point)
        return values, self.weighed(self.equations(values).counting(self.loss), values)

    def values_of(self, problem: FreeRunResiduals, points: Samples) -> Samples:
        """Return (..., n) scaled values at those of fewer parameters."""
        absent = np.array([getattr(LumpedParameters, name, 0.0) for name in self.names])
        values = np.broadcast_to(absent / self.scale, (*points.shape[:-1], absent.size)).copy()
        places = [self.keys.index(key) for key in problem.keys]
        values[..., places] = points * problem.scale / self.scale[places]
        return values

    @cached_property
    def conditions(self) -> Conditions:
        """Under which the cells were recorded."""
        cells = cells_of(len(self.simulations), len(self.keys))
        return Conditions.of([each.log for each in self.simulations], cells)

    def lacking(self, problem: FreeRunResiduals, point: Samples) -> str | None:
        """Return the rarer term, of those here, that fewer parameters lack where they ended."""
        tried = [n for n, _ in self.keys if n in RARER and (n, None) not in problem.keys]
        if not tried:
            return None
        values, at = self.about(problem, point)
        cells = cells_of(len(at.logs), len(self.keys))
        return lacking_term(self.about_point(values, at, cells), tried, self.conditions)

    def inseparable(self, at: Equations) -> tuple[str, ...]:
        """Return a term, and what comes with it, that the equations cannot tell from the others."""
        rows = np.concatenate(at.compressed(1)[0])
        told = None if at.known is None else at.known[0].active
        conditioning = Conditioning.of(rows, self.names, told)
        doubtful = [n for n in conditioning.weakest if n in {*TRIED, *offered("output-error")}]
        if conditioning.number <= SINGULAR_CONDITION or not doubtful:
            return ()
        last = doubtful[-1]
        together = {last, *TERMS[last].follows}
        together |= companions(together)
        return tuple(name for name in self.names if name in together)

    def untold(self, end: Minimum) -> str | None:
        """Return what of the shape of a base's motion could as well be 0, or twice as large."""
        names = self.names
        shape = [names.index(name) for name in sorted(companions({BASE})) if name in names]
        if not shape:
            return None
        found = self.solved(end, cells=1)
        if mute := [k for k in shape if not found.rows[:, :, k].any()]:
            return names[mute[0]]
        covariance, _ = cluster_covariance(found.rows, found.residuals, found.prior)
        told = np.abs(found.values[shape]) / np.sqrt(np.diag(covariance)[shape])
        return names[shape[int(np.argmin(told))]] if np.min(told) < SPREADS else None

    def holding(self, name: str, point: Samples) -> FreeRunResiduals:
        """Return the residuals with a parameter held at its value of (n,) scaled ones."""
        kept = np.flatnonzero([key != (name, None) for key in self.keys])
        value = float((point * self.scale)[self.keys.index((name, None))])
        fewer = self.keeping(kept, point[kept])
        return replace(fewer, start=replace(fewer.start, **{name: value}))

    def solved(self, end: Minimum, cells: int | None = None) -> CellEquations:
        """Return the equations about the end of a descent, in the parameters themselves."""
        cells = cells or cells_of(len(self.simulations), len(self.keys))
        scale, scaled = self.scale, self.about_point(end.point, end.at, cells)
        prior = scaled.prior
        found = replace(
            scaled,
            names=self.names,
            values=end.point * scale,
            rows=scaled.rows / scale,
            lower=self.lower * scale,
            prior=None if prior is None else prior.turned(scale, np.zeros(scale.size)),
            bread=None if end.at.loss is Loss.LINEAR else end.at.bread / np.outer(scale, scale),
        )
        return found if end.converged else found.stopped(found.next_step)

    def about_point(self, point: Samples, at: Equations, cells: int) -> CellEquations:
        """Return the equations about (n,) scaled values, each log cut into some cells."""
        logs = len(at.logs)
        rows, residuals = at.compressed(cells)
        return CellEquations(
            names=self.labels,
            values=point,
            lower=self.lower,
            on_bound=point <= self.lower,
            rows=rows,
            residuals=residuals,
            log=np.repeat(np.arange(logs), cells),
            prior=None if at.known is None else at.known[0],
        )

    @np.errstate(over="ignore", invalid="ignore")  # of a motion that no joint makes; per thread
    def _of_log(self, index: int, values: Samples, *, slopes: bool) -> LogEquations:
        simulation = self.simulations[index]
        columns = columns_of(self.keys, simulation.log)
        own = {self.keys[k][0]: float(values[k]) for k in columns}
        moved = {name: value for name, value in own.items() if name not in INITIAL}
        parameters = replace(self.start, **moved)
        if not parameters.p1 + simulation.log.added_mass.inertia > 0:
            return _impossible(len(self.keys))
        fastest = parameters.base_frequency * max(1.0, 2 * parameters.base_damping)
        if parameters.base_compliance and PRECISE * simulation.log.mean_step * fastest > 1:
            return _impossible(len(self.keys))  # a base that settles in a tenth of a clock's step
        zero = own["zero"] if "zero" in own else reading_of(simulation.log, self.zeros)
        names = list(own) if slopes else []
        errors, rows, mixture = simulation.linearised(names, parameters, zero, own.get("velocity"))
        unit = 1 / (self.motion[index] * errors.size**0.5)
        scaled = np.zeros((mixture.shape[0], len(self.keys)))
        moving = columns[: len(names)]
        scaled[:, moving] = unit * mixture * self.scale[moving]
        return LogEquations(residuals=unit * errors, rows=rows, mixture=scaled)


def _impossible(count: int) -> LogEquations:
    """Return the equations of a joint that there is not, from which a descent steps back."""
    none = np.zeros((1, 1))
    return LogEquations(residuals=np.full(1, np.inf), rows=none, mixture=np.zeros((1, count)))


def _least_inertia(logs: Sequence[Log], start: LumpedParameters) -> float:
    """Return the least p1: the speed settles in a hundredth of a clock's step, which none shows."""
    carried = min(log.added_mass.inertia for log in logs)
    settled = start.p2 * min(log.mean_step for log in logs) / FINEST
    return max(settled, ROUNDING * (start.p1 + carried)) - carried


def _rms_motion(log: Log, first: int) -> float:
    """Return that of what was measured from a sample on, by which its errors are divided."""
    motion = float(np.std(log.measured[first:])) if first < log.angle.size else 0.0
    if not motion > ROUNDING:
        found = f"{motion:.1g} {log.unit} rms motion in the samples that are fitted"
        raise InputError(log.source, log.measures, found, "a moving joint: exclude this log")
    return motion


def _first_guess(
    key: Key,
    logs: Sequence[Log],
    start: LumpedParameters,
    zeros: Mapping[AddedMass, float],
    sizes: Mapping[str, float],
) -> float:
    name, whose = key
    if name == "zero":
        masses = {log.added_mass for log in logs if whose in {None, log.added_mass, log.name}}
        return float(np.median([zeros[mass] for mass in masses]))
    guess = float(getattr(start, name, 0.0))
    lost = guess == 0 and name in TERMS and not TERMS[name].sign_observable
    # Where the sign does not show the derivative is 0 at 0: the fit would stay there.
    return sizes[name] if lost else guess


def _scales(logs: Sequence[Log], start: LumpedParameters) -> dict[str, float]:
    """Size of each parameter whose torque would be a tenth of the motor's, as large for p1, p3."""
    swing = float(np.median([log.rms_motion for log in logs]))
    command = float(np.median([1.0, *(np.std(log.input) for log in logs)])) or 1.0
    rate = float(np.median([log.excitation.omega for log in logs if log.excitation] or [5.0]))
    inertia = abs(start.p1) + max(log.added_mass.inertia for log in logs)
    torque, speed = inertia * swing * rate**2, swing * rate
    weight = max([1e-3, *(log.added_mass.weight for log in logs)])
    angle, velocity = swing * np.sin(_PHASES), speed * np.cos(_PHASES)
    mass = max([1e-3, *(log.added_mass.mass for log in logs)])
    own = {"weight": weight, "mass": mass, "input": command * np.sin(_PHASES)}
    motion = start.motion(angle, velocity, **own)
    sizes = {
        "p1": inertia,
        "p3": torque / swing,
        "p4": abs(start.p4) or torque / command,
        "zero": swing,
        "velocity": speed,
    }
    for row in TERMS.values():
        if row.size is not None:
            sizes.setdefault(row.name, row.size(torque, speed, rate))
        elif row.basis is not None and row.name not in sizes:
            whole = command if row.of_gain else torque
            sizes[row.name] = 0.1 * whole / float(np.abs(row.basis(motion)).max())
    return sizes
