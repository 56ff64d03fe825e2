"""Residuals: what the free runs of a whole model leave of each log, and what explains it.

From the errors of the free runs is taken what a small change of the parameters, of zeros and of
each log's start would take from them, to first order and jointly: a value that is off within its
interval is no misfit of the model. What stays is compared with errors drawn as each log's own
encoder and noise make them, averaged and reduced alike (a parametric bootstrap: Efron & Tibshirani,
An Introduction to the Bootstrap, 1993, section 6.5). The terms of the table that the model lacks
are offered to the one rule that chooses terms, on the same equations: those are missing that
predict logs better that were left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import IdentifiabilityError
from butterfly.identification.blocks import independent_cells_of
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.diagnostics.sensor_errors import (
    LEVELS,
    Curve,
    SensorErrors,
    correlations,
)
from butterfly.identification.draws import covariance_root, honest_covariance
from butterfly.identification.equations import CellEquations, compressed
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FreeRun, Setting
from butterfly.identification.inference.covariance import SPREADS
from butterfly.identification.inference.term_choice import (
    candidates,
    choose_terms,
    stribeck_velocities,
    submodels_of,
)
from butterfly.identification.segments import Segments
from butterfly.identification.simulation import Simulation
from butterfly.identification.test_functions import HALF_WIDTH, Averaging
from butterfly.logs.log import Log
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.model.terms import PARAMETERS, TERMS, lower_bounds
from butterfly.signals.frequency_response import first_counted

Samples = NDArray[np.float64]

_ALLOWED = 7e-4  # misfit over rms swing that counts for nothing: no free run is more exact
_LONGEST_LAG = 2.0  # of the correlations, in s; a quarter of the errors at most
_DRAWN = 24  # sets of sensor errors
_BY_CHANCE = 0.25  # share of logs that may be outside
_FIRST_ORDER = 0.05  # share of the residuals, to which derivatives foretell them
INDEPENDENT = 1e-6
"""Size over the largest, below which a direction is none."""

_NO_ERRORS = SensorErrors(step=0.0, noise=0.0)
_LENGTHS = ("motion", "error", "after_small_changes", "by_sensors", "encoder_step", "noise")


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorBand:
    """How far a reading may be from the simulation, by the parameters and the sensor."""

    time: Samples  # (m,) instants in s
    reach: Samples  # (m,) half widths in rad, at `CONFIDENCE`


@dataclass(frozen=True, kw_only=True, eq=False)
class LogResiduals:
    """What the free run leaves of one log, where its errors count (see `first_counted`).

    The defaults are those of a log that could not be simulated, or in which nothing moves.
    """

    name: str  # of the log
    label: str
    motion: float  # rms of the measured angle about its mean, in rad
    # rms of measured less simulated angle in rad, averaged over steps of the simulation
    error: float = np.inf
    left: float = np.inf  # less what a small change of parameters would take from it
    explained: float = 0.0  # the same of errors drawn as the log's sensor makes them
    share: float = 0.0  # of the squares of what is left that the missing terms explain
    sensor: SensorErrors = _NO_ERRORS
    # of what is left with itself, and with the input before it
    autocorrelation: Curve | None = None
    cross_correlation: Curve | None = None
    band: ErrorBand | None = None  # about the simulated angle, within which a reading is expected

    @cached_property
    def excess(self) -> tuple[float, float]:
        """How far the curves reach, over inner and outer band: above 1, one leaves it."""
        curves = [each for each in (self.autocorrelation, self.cross_correlation) if each]
        if not curves:
            return np.inf, np.inf
        inner, outer = np.max([curve.excess for curve in curves], axis=0).tolist()
        return inner, outer

    @property
    def outside(self) -> bool:
        """Whether it is more than sensors explain, of which 5 % of good logs are accused."""
        return self.excess[0] > 1

    @property
    def relative(self) -> float:
        """Rms error over rms motion."""
        return self.error / self.motion if self.motion else np.inf

    @property
    def times(self) -> float:
        """What is left over what the sensor explains."""
        return self.left / self.explained if self.explained else np.inf

    def numbers(self) -> dict[str, Any]:
        """Return it for programs."""
        sensor = self.sensor
        lengths = (self.motion, self.error, self.left, self.explained, sensor.step, sensor.noise)
        return {
            "log": self.name,
            **dict(zip(_LENGTHS, lengths, strict=True)),
            "over_band": dict(zip(map(str, LEVELS), self.excess, strict=True)),
            "missing_terms_share": self.share,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class MissingTerms:
    """The terms of the table that the model lacks, and that help to predict logs left out."""

    terms: tuple[str, ...] = ()
    others: tuple[tuple[str, ...], ...] = ()  # sets of as many that predict as well
    share: float = 0.0  # of the squares of what is left that they explain
    moved: tuple[str, ...] = ()  # parameters that they move by more than their intervals allow

    @property
    def names(self) -> str:
        """Names of the terms and of their alternatives."""
        return " or ".join(" + ".join(each) for each in (self.terms, *self.others) if each)

    @property
    def findings(self) -> list[Finding]:
        """Tell which they are, and what they move."""
        if not self.terms:
            return []
        concerned = (self.names, *self.moved)
        return [Finding(FindingKind.MISSING_TERM, concerned, number=self.share)]


@dataclass(frozen=True, kw_only=True, eq=False)
class Residuals:
    """What the free runs of all logs leave."""

    logs: tuple[LogResiduals, ...]  # one for each log of the data set
    missing: MissingTerms = MissingTerms()

    @property
    def outside(self) -> int:
        """How many logs are more than sensors explain."""
        return sum(log.outside for log in self.logs)

    @property
    def relative(self) -> float:
        """Rms over the logs of error over motion."""
        return float(np.sqrt(np.mean([log.relative**2 for log in self.logs])))

    @property
    def explained(self) -> float:
        """Rms over the logs of what sensors explain over motion."""
        shares = [log.explained / log.motion for log in self.logs if log.motion]
        return float(np.sqrt(np.mean(np.square(shares)))) if shares else np.inf

    @property
    def left(self) -> float:
        """Rms over the logs of what no small change of the parameters explains, over motion."""
        shares = [log.left / log.motion if log.motion else np.inf for log in self.logs]
        return float(np.sqrt(np.mean(np.square(shares))))

    @property
    def times(self) -> float:
        """What is left over what sensors explain."""
        return self.left / self.explained if self.explained else np.inf

    @property
    def beyond_sensors(self) -> bool:
        """Whether more logs are outside than chance explains in those of one robot and one clock.

        One log in twenty is by chance; those of one robot are hardly independent of each other.
        """
        return self.outside > _BY_CHANCE * len(self.logs)

    @property
    def findings(self) -> list[Finding]:
        """How near the model follows, how far beyond the sensors, and which terms are missing."""
        kind = FindingKind.MISFIT if self.beyond_sensors else FindingKind.NO_MISFIT
        followed = Finding(FindingKind.FOLLOWED, number=self.left)
        return [followed, Finding(kind, number=self.times), *self.missing.findings]

    def numbers(self) -> dict[str, Any]:
        """Return it for programs but for its findings: shares of the rms motion, over all logs."""
        return {
            "relative": self.relative,
            "after_small_changes": self.left,
            "by_sensors": self.explained,
            "times_sensors": self.times,
            "beyond_sensors": self.beyond_sensors,
            "logs_outside": self.outside,
            "missing_terms": list(self.missing.terms),
            "missing_terms_or": [list(each) for each in self.missing.others],
            "missing_terms_share": self.missing.share,
            "logs": [log.numbers() for log in self.logs],
        }


def residual_units(joint: JointKind, place: str = "residuals.") -> dict[str, str]:
    """Return the units of `Residuals.numbers` that stand in some place of a document."""
    return {f"{place}logs.{name}": joint.way for name in _LENGTHS}


def residuals_of(data: DataSet, estimate: Estimate, runs: Sequence[FreeRun] = ()) -> Residuals:
    """Compare what the free runs of an estimate leave with what sensors and missing terms explain.

    The ``runs`` are those of all logs with the estimate, if they are simulated already.
    """
    model = _Model.of(data, estimate)
    every = [
        _Linearised.of(
            runs[k] if runs else data.simulations.run(k, estimate),
            data.simulations.setting(k, estimate),
            model,
        )
        for k in range(len(data.logs))
    ]
    logs = [each for each in every if isinstance(each, _Linearised)]
    if not logs:
        return Residuals(logs=tuple(each for each in every if isinstance(each, LogResiduals)))
    directions = _directions(logs)
    left = _reduced(logs, directions, [each.errors[:, None] for each in logs])
    random = np.random.default_rng(0)
    pairs = [each.drawn(rest[:, 0], random) for each, rest in zip(logs, left, strict=True)]
    drawn = _reduced(logs, directions, [errors for _, errors in pairs])
    judged = [
        each.judged(np.column_stack([rest, errors]), sensor)
        for each, rest, errors, (sensor, _) in zip(logs, left, drawn, pairs, strict=True)
    ]
    missing = MissingTerms()
    if model.lacking and sum(each.outside for each in judged) > _BY_CHANCE * len(every):
        missing, shares = _missing_terms(estimate, logs, directions, model.lacking)
        both = zip(judged, shares, strict=True)
        judged = [replace(each, share=float(share)) for each, share in both]
    rest = iter(judged)
    whole = (each if isinstance(each, LogResiduals) else next(rest) for each in every)
    return Residuals(logs=tuple(whole), missing=missing)


class _Model(NamedTuple):
    """What the errors are differentiated by."""

    names: tuple[str, ...]  # parameters that logs share
    owners: list[tuple[str, AddedMass | str | None]]  # whose each zero and bias is
    lacking: tuple[str, ...]  # terms of the table that the model lacks and the logs may tell
    slow: float  # velocity in rad/s below which Stribeck friction is looked for
    root: Samples  # (n, n) root of the covariance; zeros where there is none

    @classmethod
    def of(cls, data: DataSet, estimate: Estimate) -> _Model:
        owners = estimate.owners(data.unread)
        has = {*estimate.names, *(name for name, _ in owners)}
        named = [row.name for row in TERMS.values() if row.looks_like and row.name not in has]
        lacking = candidates(named, data.masses, estimate.known)
        fastest = math.sqrt(2) * max(log.rms_speed for log in data.logs)
        speeds = stribeck_velocities(fastest, estimate.known) or [1.0]
        try:
            root = covariance_root(honest_covariance(estimate))
        except IdentifiabilityError:
            root = np.zeros((len(estimate.names),) * 2)
        return cls(
            names=estimate.names,
            owners=owners,
            lacking=tuple(name for name in lacking if not getattr(estimate.parameters, name)),
            slow=speeds[len(speeds) // 2],
            root=root,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Linearised:
    """One log's free run, where its errors count, and what it changes by.

    A log's own are the velocity and the true angle at its start, which the encoder has rounded: a
    change of it moves the readings by 1 less what one of the zero does.
    """

    run: FreeRun
    simulation: Simulation | Segments
    setting: Setting
    counted: slice  # the samples whose errors count
    motion: float  # rms of the measured angle about its mean, in rad
    whole: Samples  # (m,) simulated less measured angle in rad
    # (k, j) orthonormal directions in which the log's own start moves it, k of m after k where the
    # log is simulated in segments, each from a start of its own
    own: tuple[Samples, ...]
    errors: Samples  # (m,) errors less those directions
    known: Samples  # (m, n) derivatives by what the model has, less those directions
    lacking: Samples  # (m, j) derivatives by the terms that it lacks, less those directions
    # (m,) standard deviations in rad that the parameters' own errors give the simulated angle, to
    # first order; zeros where the estimate says nothing of them
    reach: Samples

    @classmethod
    def of(cls, run: FreeRun, setting: Setting, model: _Model) -> _Linearised | LogResiduals:
        """Differentiate a log's free run; what is left stays bare if it fails or nothing moves."""
        log, parameters = run.log, setting.parameters
        first = first_counted(log)
        motion = float(np.std(log.angle[first:]))
        if "stribeck" in model.lacking:
            parameters = replace(parameters, stribeck_velocity=model.slow)
        local = dict.fromkeys(["zero", "velocity", *(name for name, _ in model.owners)])
        asked = [*model.names, *local, *model.lacking]
        simulation = setting.simulation(log, first)
        with np.errstate(all="ignore"):
            whole, rows, mixture = simulation.linearised(
                asked, parameters, setting.zero, setting.velocity
            )
            slopes = rows @ mixture
        numbers = (run.fit, whole, slopes)
        if not (motion > 0 and all(np.isfinite(each).all() for each in numbers)):
            return LogResiduals(name=log.name, label=log.label, motion=motion)
        of = dict(zip(asked, slopes.T, strict=True))
        if isinstance(simulation, Segments):
            own = simulation.directions(parameters, setting.zero)
        else:
            own = (_orthonormal(np.column_stack([1 - of["zero"], of["velocity"]])),)
        mine, n = {None, log.added_mass, log.name}, len(model.names)
        columns = [whole, *slopes[:, :n].T]
        columns += [of[name] * (whose in mine) for name, whose in model.owners]
        columns += [of[name] for name in model.lacking]
        rest = _less(own, np.column_stack(columns))
        split = rest.shape[1] - len(model.lacking)
        return cls(
            run=run,
            simulation=simulation,
            setting=setting,
            counted=slice(first, None),
            motion=motion,
            whole=whole,
            own=own,
            errors=rest[:, 0],
            known=rest[:, 1:split],
            lacking=rest[:, split:],
            reach=np.linalg.norm(slopes[:, :n] @ model.root.T, axis=1),
        )

    @property
    def unit(self) -> float:
        """What makes squared errors add up to their mean over that of the motion."""
        return float(1 / (self.motion * self.errors.size**0.5))

    @property
    def unsure(self) -> float:
        """What counts for nothing, in rad: a share of the motion about its straight line."""
        time, angle = (each[self.counted] for each in (self.run.log.time, self.run.log.angle))
        line = np.column_stack([np.ones(time.size), time - time.mean()])
        return _ALLOWED * _rms(angle - line @ np.linalg.lstsq(line, angle, rcond=None)[0])

    def drawn(self, left: Samples, random: np.random.Generator) -> tuple[SensorErrors, Samples]:
        """Return the log's sensor, and (m, k) sets of its errors, none if they are white.

        They are errors about the free run as changed parameters would have it, ``left`` being the
        (m,) errors that stay; what the log's start explains is taken from them.
        """
        log = self.run.log
        time, measured = log.time[self.counted], log.angle[self.counted]
        middles = self.simulation.middles()
        angle = self.run.simulated.copy()
        angle[self.counted] -= np.interp(time, middles, self.whole - left)
        sensor = SensorErrors.of(measured, angle[self.counted])
        if sensor.white:
            return sensor, np.empty((self.whole.size, 0))
        drawn = (sensor.draw(angle, random, unsure=self.unsure) for _ in range(_DRAWN))
        return sensor, _less(self.own, np.column_stack([*map(self.simulation.averaged, drawn)]))

    def judged(self, errors: Samples, sensor: SensorErrors) -> LogResiduals:
        """Judge the log by its (m, 1 + k) errors: what is left of its own, and of those drawn."""
        left, count, step = _rms(errors[:, 0]), errors.shape[0], self.simulation.step
        lags = max(1, min(round(_LONGEST_LAG / step), count // 4))
        lag = step * np.arange(lags + 1)
        allowed = self.unsure / left if left else 0.0
        inputs = self.simulation.mean_inputs(self.setting.parameters)
        own, crossed = correlations(errors, inputs, lags)
        # the spread of the parameters, to first order, beside that of the readings
        reach = SPREADS * np.hypot(self.reach, sensor.spread)
        log = self.run.log
        white = sensor.spread / (log.time[self.counted].size / count) ** 0.5
        return LogResiduals(
            name=log.name,
            label=log.label,
            motion=self.motion,
            error=_rms(self.whole),
            left=left,
            explained=white if sensor.white else _rms(errors[:, 1:]),
            sensor=sensor,
            autocorrelation=Curve.of(lag[1:], own, count, allowed**2),
            cross_correlation=Curve.of(lag, crossed, count, allowed),
            band=ErrorBand(time=self.simulation.middles(), reach=reach),
        )


def _directions(logs: Sequence[_Linearised]) -> Samples:
    """(n, d) changes of what the model has that move all errors by 1, each in its own way.

    Each log counts as it does in output error, by the mean square of its errors over its motion.
    """
    normal = sum(each.unit**2 * each.known.T @ each.known for each in logs)
    size = np.sqrt(np.diag(normal))
    size[size == 0] = 1.0
    powers, axes = np.linalg.eigh(normal / np.outer(size, size))
    told = powers > INDEPENDENT**2 * powers.max(initial=0.0)
    return np.asarray(axes[:, told] / np.sqrt(powers[told]) / size[:, None])


def _reduced(
    logs: Sequence[_Linearised], directions: Samples, errors: Sequence[Samples]
) -> list[Samples]:
    """Take from each log's (m, k) errors what a change of what the model has explains, jointly.

    A log may have none.
    """
    pairs = list(zip(logs, errors, strict=True))
    pulls = [each.unit**2 * each.known.T @ own for each, own in pairs if own.size]
    if not pulls:
        return list(errors)
    change = directions @ (directions.T @ sum(pulls))
    return [own - each.known @ change if own.size else own for each, own in pairs]


def _missing_terms(
    estimate: Estimate, logs: Sequence[_Linearised], directions: Samples, lacking: tuple[str, ...]
) -> tuple[MissingTerms, Samples]:
    """Choose from the terms that the model lacks; and (k,) shares of each log that they explain."""
    always = tuple(f"change {k}" for k in range(directions.shape[1]))
    names = (*always, *lacking)
    cells = independent_cells_of(len(logs), len(names))
    every = [
        each.unit * np.column_stack([each.known @ directions, each.lacking, each.errors])
        for each in logs
    ]
    parts = [part for own in every for part in np.array_split(own, cells)]
    rows, residuals = compressed((part[:, :-1], part[:, -1]) for part in parts)
    equations = CellEquations(
        names=names,
        values=np.zeros(len(names)),
        lower=np.append(np.full(len(always), -np.inf), lower_bounds(lacking)),
        on_bound=np.zeros(len(names), dtype=bool),
        rows=rows,
        residuals=residuals,
        log=np.repeat(np.arange(len(logs)), cells),
    )
    rounding = _FIRST_ORDER * float(np.sqrt(equations.cost.sum() / len(logs)))
    nested = submodels_of(equations, [each.run.log.added_mass for each in logs], rounding)
    none = np.array([[name in always for name in nested.names]])
    try:
        chosen = choose_terms([nested], always=always)
    except IdentifiabilityError:
        return MissingTerms(), np.zeros(len(logs))
    ends = np.array([nested.fitted(none)[0], [chosen.values[name] for name in nested.names]])
    before, after = nested.costs(ends).reshape(2, len(logs), -1).sum(axis=2)
    shares = 1 - after / np.where(before > 0, before, 1.0)
    moved = directions @ (ends[1] - ends[0])[: len(always)]
    half = (estimate.upper - estimate.lower) / 2
    limits = zip(estimate.names, moved[: half.size], half, strict=True)
    rivals = (tuple(name for name in lacking if values[name]) for values in chosen.rivals)
    alike = dict.fromkeys(each for each in rivals if len(each) == len(chosen.terms))
    return MissingTerms(
        terms=chosen.terms,
        others=tuple(each for each in alike if each != chosen.terms),
        share=float(1 - after.sum() / before.sum()) if before.sum() else 0.0,
        moved=tuple(
            name for name, step, limit in limits if name in PARAMETERS and abs(step) > limit
        )
        if chosen.terms
        else (),
    ), shares


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualTorque:
    """The residuals of one log seen at the joint: the torque that all terms leave of the motor's.

    Averaged over bumps, the acceleration becomes int phi'' th, so nothing is differentiated twice;
    where the joint may stick, friction is no function of the motion and nothing is said.
    """

    label: str  # of the log
    # (n,) instants in s at which the joint moves, angle in rad from the hanging position, velocity
    # in rad/s, N m
    time: Samples
    angle: Samples
    velocity: Samples
    torque: Samples

    @classmethod
    def of(cls, log: Log, setting: Setting) -> ResidualTorque:
        """Subtract all terms: tau_eps = p1 thdd + p2 thd + p3 sin th + ... - p4 v (5).

        InputError if the log is shorter than a bump. The load on the bearing enters by its own
        basis, so that T_c is the bare hand's.
        """
        values = setting.parameters
        loaded = values.with_added_mass(log.added_mass)
        omega = log.excitation.omega if log.excitation else resonance_frequency(loaded)
        width = min(HALF_WIDTH, math.pi / (4 * omega)) if omega else HALF_WIDTH
        acting = [row.name for row in TERMS.values() if row.basis or row.derivative]
        signals = Averaging(log, setting.zero, width, values).signals(
            acting, delay=values.delay, drive=values.drive
        )
        sizes = {name: getattr(values, name) for name in acting if not TERMS[name].of_gain}
        sizes |= {"p1": loaded.p1, "p3": loaded.p3}
        torque = sum(size * signals.mean[name] for name, size in sizes.items())
        moving = signals.moving
        return cls(
            label=log.label,
            time=signals.time[moving],
            angle=signals.angle[moving],
            velocity=signals.velocity[moving],
            torque=np.asarray(torque)[moving],
        )


def _rms(values: Samples) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def _orthonormal(columns: Samples) -> Samples:
    """Return (m, j) orthonormal columns that span those of (m, k) that are felt at all."""
    sizes = np.linalg.norm(columns, axis=0)
    felt = sizes > INDEPENDENT * columns.shape[0] ** 0.5
    left, singular, _ = np.linalg.svd(columns[:, felt] / sizes[felt], full_matrices=False)
    return np.asarray(left[:, singular > INDEPENDENT * singular.max(initial=0.0)])


def _less(directions: Sequence[Samples], errors: Samples) -> Samples:
    """Take from (m, k) errors the orthonormal directions of stretches, one after the other."""
    ends = np.cumsum([each.shape[0] for each in directions])[:-1]
    pairs = zip(directions, np.split(errors, ends), strict=True)
    return np.concatenate([part - each @ (each.T @ part) for each, part in pairs])
