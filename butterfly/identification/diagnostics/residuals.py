"""Residuals: what the free runs of a whole model leave of each log, and what explains it.

From the errors of the free runs is taken what a small change of the parameters, of zeros and of
each log's start would take from them, to first order and jointly: a value that is off within its
interval is no misfit. What stays is compared with errors drawn as each log's encoder and noise make
them (a parametric bootstrap: Efron & Tibshirani, An Introduction to the Bootstrap, 1993, section
6.5). Those terms are missing that predict logs better that were left out, by the same equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.blocks import Condition, Conditions, cells_of, independent_cells_of
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.diagnostics.linearised_run import (
    Derivatives,
    LinearisedRun,
    directions_of,
    reduce,
    rms,
)
from butterfly.identification.diagnostics.sensor_errors import Curve, SensorErrors, correlations
from butterfly.identification.equations import CellEquations, compressed
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FreeRun
from butterfly.identification.inference.agreement import (
    Contrast,
    contrasts_of,
    differing_values,
    from_log_to_log,
)
from butterfly.identification.inference.linear_terms import LinearModel
from butterfly.identification.inference.stagewise import stagewise
from butterfly.identification.inference.submodels import submodels_of
from butterfly.identification.levels import PRECISE, SPREADS
from butterfly.logs.log import Log
from butterfly.model.parameters import JointKind
from butterfly.model.terms import PARAMETERS, lower_bounds
from butterfly.signals.frequency_response import first_counted

_LONGEST_LAG = 2.0  # of the correlations, in s; a quarter of the errors at most
_BY_CHANCE = 0.25  # share of logs that may be outside

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
    def excess(self) -> float:
        """How far the curves reach, over the half-width of their bands: above 1, one leaves it."""
        curves = (self.autocorrelation, self.cross_correlation)
        return max((each.excess for each in curves if each), default=np.inf)

    @property
    def outside(self) -> bool:
        """Whether it is more than sensors explain, of which 5 % of good logs are accused."""
        return self.excess > 1

    @property
    def relative(self) -> float:
        """Rms error over rms motion."""
        return self.error / self.motion if self.motion else np.inf

    @property
    def times(self) -> float:
        """What is left, divided by what the sensor explains."""
        return self.left / self.explained if self.explained else np.inf

    def numbers(self) -> dict[str, Any]:
        """Return it for programs."""
        sensor = self.sensor
        lengths = (self.motion, self.error, self.left, self.explained, sensor.step, sensor.noise)
        return {
            "log": self.name,
            **dict(zip(_LENGTHS, lengths, strict=True)),
            "over_band": self.excess,
            "missing_terms_share": self.share,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class MissingTerms:
    """The terms of the table that the model lacks, and that help to predict logs left out."""

    terms: tuple[str, ...] = ()
    others: tuple[tuple[str, ...], ...] = ()  # sets of as many that predict as well
    share: float = 0.0  # of the squares of what is left that they explain
    moved: tuple[str, ...] = ()  # parameters that they move by more than their intervals allow
    rival: Samples | None = None  # (n,) values with them, if they move any so far

    @property
    def names(self) -> str:
        """Names of the terms and of their alternatives."""
        return " or ".join(" + ".join(each) for each in (self.terms, *self.others) if each)

    @property
    def findings(self) -> list[Finding]:
        """Tell which they are, and what they move."""
        if not self.terms:
            return []
        return [Finding(FindingKind.MISSING_TERM, (self.names, *self.moved), number=self.share)]


@dataclass(frozen=True, kw_only=True, eq=False)
class Residuals:
    """What the free runs of all logs leave."""

    logs: tuple[LogResiduals, ...]  # one for each log of the data set
    missing: MissingTerms = MissingTerms()
    # what follows a condition, where sensors do not explain it; and (n,) values that hold as well
    agreement: tuple[Contrast, ...] = ()
    rivals: tuple[Samples, ...] = ()

    @property
    def outside(self) -> int:
        """How many logs are more than sensors explain."""
        return sum(log.outside for log in self.logs)

    @property
    def relative(self) -> float:
        """Rms over the logs of error over motion."""
        return self._over_motion([log.error for log in self.logs])

    @property
    def explained(self) -> float:
        """Rms over the logs of what sensors explain over motion."""
        return self._over_motion([log.explained for log in self.logs])

    @property
    def left(self) -> float:
        """Rms over the logs of what no small change of the parameters explains, over motion."""
        return self._over_motion([log.left for log in self.logs])

    def _over_motion(self, lengths: Sequence[float]) -> float:
        """Return the rms over the logs that move of a length over the motion."""
        pairs = zip(lengths, self.logs, strict=True)
        shares = [each / log.motion for each, log in pairs if log.motion]
        return float(np.sqrt(np.mean(np.square(shares)))) if shares else np.inf

    @property
    def times(self) -> float:
        """What is left, divided by what sensors explain."""
        return self.left / self.explained if self.explained else np.inf

    @property
    def beyond_sensors(self) -> bool:
        """Whether more logs are outside than chance explains in those of one robot and clock."""
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
    """Compare what free runs of an estimate leave with what sensors and lacking terms explain."""
    model = Derivatives.of(data, estimate)
    every = [
        LinearisedRun.of(
            runs[k] if runs else data.simulations.run(k, estimate),
            data.simulations.setting(k, estimate),
            model,
        )
        for k in range(len(data.logs))
    ]
    logs = [each for each in every if each is not None]
    if not logs:
        return Residuals(logs=tuple(map(_bare, data.logs)))
    directions = directions_of(logs)
    left = [each.errors[:, None].copy() for each in logs]
    reduce(logs, directions, left)
    random = np.random.default_rng(0)
    pairs = [each.drawn(rest[:, 0], random) for each, rest in zip(logs, left, strict=True)]
    reduce(logs, directions, [errors for _, errors in pairs])
    judged = [
        _judged(each, rest[:, 0], errors, sensor)
        for each, rest, (sensor, errors) in zip(logs, left, pairs, strict=True)
    ]
    missing, beyond = MissingTerms(), sum(each.outside for each in judged) > _BY_CHANCE * len(every)
    agreement, rivals = _contrasts(estimate, logs, directions, left) if beyond else ((), ())
    if model.lacking and beyond:
        missing, shares = _missing_terms(estimate, logs, directions, model.lacking)
        both = zip(judged, shares, strict=True)
        judged = [replace(each, share=float(share)) for each, share in both]
    rest = iter(judged)
    pairs_of_logs = zip(data.logs, every, strict=True)
    whole = (_bare(log) if each is None else next(rest) for log, each in pairs_of_logs)
    return Residuals(logs=tuple(whole), missing=missing, agreement=agreement, rivals=rivals)


def _bare(log: Log) -> LogResiduals:
    """Return what there is to say of a log that cannot be simulated, or in which nothing moves."""
    motion = float(np.std(log.measured[first_counted(log) :]))
    return LogResiduals(name=log.name, label=log.label, motion=motion)


def _judged(
    each: LinearisedRun, errors: Samples, drawn: Samples, sensor: SensorErrors
) -> LogResiduals:
    """Judge a log by its (m,) errors that are left, and by (m, k) that are drawn."""
    left, count, step = rms(errors), errors.size, each.step
    lags = max(1, min(round(_LONGEST_LAG / step), count // 4))
    lag = np.asarray(step * np.arange(lags + 1), dtype=np.float64)
    allowed = each.unsure / left if left else 0.0
    own, crossed = correlations([errors, *drawn.T], each.inputs, lags)
    # the spread of the parameters, to first order, beside that of the readings
    reach = SPREADS * np.hypot(each.reach, sensor.spread)
    log = each.run.log
    white = sensor.spread / (log.time[each.counted].size / count) ** 0.5
    return LogResiduals(
        name=log.name,
        label=log.label,
        motion=each.motion,
        error=rms(each.whole),
        left=left,
        explained=white if sensor.white else rms(drawn),
        sensor=sensor,
        autocorrelation=Curve.of(lag[1:], own, count, allowed**2),
        cross_correlation=Curve.of(lag, crossed, count, allowed),
        band=ErrorBand(time=each.middles, reach=reach),
    )


def _contrasts(
    estimate: Estimate, logs: Sequence[LinearisedRun], directions: Samples, left: Sequence[Samples]
) -> tuple[tuple[Contrast, ...], tuple[Samples, ...]]:
    """Return what follows a condition in (m, 1) errors, and (n,) values that hold as well."""
    names, known = estimate.names, logs[0].known.shape[1]
    cells = cells_of(len(logs), known)
    every = [
        each.unit * np.column_stack([each.known, own]) for each, own in zip(logs, left, strict=True)
    ]
    parts = [part for own in every for part in np.array_split(own, cells)]
    rows, residuals = compressed((part[:, :-1], part[:, -1]) for part in parts)
    more = known - len(names)
    pull = sum(each.unit**2 * each.known.T @ each.errors for each in logs)
    equations = CellEquations(
        names=(*names, *(f"own {k}" for k in range(more))),
        values=np.append(estimate.values, np.zeros(more)) - directions @ (directions.T @ pull),
        lower=np.append(lower_bounds(names), np.full(more, -np.inf)),
        on_bound=np.append(
            [name in estimate.on_bound for name in names], np.zeros(more, dtype=bool)
        ),
        rows=rows,
        residuals=residuals,
        log=np.repeat(np.arange(len(logs)), cells),
    )
    conditions = Conditions.of([each.run.log for each in logs], cells)
    found, ends = contrasts_of(equations, conditions)
    both = (*found, *from_log_to_log(equations.of_logs))
    found = tuple(sorted(both, key=lambda each: -each.share))
    if found and found[0].condition is Condition.LOG:
        differing = differing_values(equations, found[0].parameter)
        ends = [] if differing is None else [differing]
    return found, tuple(each[: len(names)] for each in ends)


def _missing_terms(
    estimate: Estimate, logs: Sequence[LinearisedRun], directions: Samples, lacking: tuple[str, ...]
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
    # derivatives foretell the residuals as well as a value counts as known
    rounding = PRECISE * float(np.sqrt(equations.cost.mean()))
    nested = submodels_of(equations, [each.run.log.added_mass for each in logs], rounding)
    model = LinearModel(models=(nested,), optional=lacking)
    if not model.determined:
        return MissingTerms(), np.zeros(len(logs))
    found = stagewise(model, lacking, ())
    ends = np.array([model.values, found.model.values])
    before, after = nested.costs(ends).reshape(2, len(logs), -1).sum(axis=2)
    shares = 1 - after / np.where(before > 0, before, 1.0)
    count, terms = estimate.values.size, found.path[-1]
    before_and_after = estimate.values + (ends[:, : len(always)] @ directions.T)[:, :count]
    far = np.abs(np.diff(before_and_after, axis=0)[0]) > (estimate.upper - estimate.lower) / 2
    pairs = zip(estimate.names, far.tolist(), strict=True)
    moved = tuple(name for name, own in pairs if own and name in PARAMETERS and terms)
    swapped = [(row.name, taken) for row, taken in found.ties if row.swapped(taken)]
    others = [tuple(row if name == taken else name for name in terms) for row, taken in swapped]
    return MissingTerms(
        terms=terms,
        others=tuple(others),
        share=float(1 - after.sum() / before.sum()) if before.sum() else 0.0,
        moved=moved,
        rival=before_and_after[1] if moved else None,
    ), shares
