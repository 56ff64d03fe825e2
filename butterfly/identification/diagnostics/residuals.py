"""Which term of the table, missing from a model, looks like what it leaves over.

That may be torque or, as a score test has it, errors of the free run. What a change of the model's
own coefficients would add is first taken from it and from every candidate, jointly over all logs:
only what is new can be missing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import IdentifiabilityError
from butterfly.identification.data import DataSet
from butterfly.identification.draws import covariance_root, honest_covariance
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import Setting
from butterfly.identification.segments import Segments
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.model.terms import TERMS
from butterfly.signals.window import first_counted

Samples = NDArray[np.float64]

_SURE = 4.0  # standard errors from 0 at which a coefficient counts as one
_LIKE = 0.3  # share that a term must explain of what is more than noise, to be named
_MORE_THAN_NOISE = 1.2  # rms over the noise's, from which there is something else
_OF_GRAVITY = ("p3", "p3_offset")
_ALIKE = 0.8  # of the likeliest one's share, from which another term looks like it
_SLOW = 0.3  # share of the rms velocity at which Stribeck friction is looked for
_PIECES = 10  # of a log, between which what is left is taken to be independent
_SINGULAR = 1e-8  # size over the largest, below which columns say the same
_INDEPENDENT = 1e-6  # size over the largest, below which a direction is none


class ResidualEquations(NamedTuple):
    """What one log says, at n instants."""

    # (n,) torque in N m, or simulated less measured angle in rad, that the model leaves over
    left: Samples
    known: Samples  # (n, k) what it would change by with k coefficients that the model has
    candidates: Mapping[str, Samples]  # by term: (n,) what it would change by with one unit of it
    whole: float  # rms of the motor's torque in N m, or of the motion in rad
    noise: float  # rms that the sensor's errors make of it


@dataclass(frozen=True, kw_only=True)
class ResidualSummary:
    """What the model leaves over looks like."""

    # its rms over the motor's torque, or the motion, less what a change of the model's own terms
    # would take
    relative: float
    noise: float  # share of its variance that the sensors' errors explain
    shares: dict[str, float]  # by missing term: the share that it alone explains, largest first
    # those that it looks like, the likeliest first; several where they look alike
    terms: tuple[str, ...] = ()
    size: float = 0.0  # rms of what the likeliest adds, over the same
    shows: bool = False  # whether there is more than noise and what is too little to count

    @property
    def looks_like(self) -> str:
        """Name what it looks like."""
        if not self.shows:
            return "nothing that the data can show"
        names = " or ".join(TERMS[name].looks_like for name in self.terms)
        return names or "no missing term of the table"

    def words(self, whole: str) -> str:
        """Say what it looks like, how much of it that is, and how large beside ``whole``."""
        if not self.shows:
            return self.looks_like
        if not self.terms:
            return f"{self.looks_like} ({100 * self.relative:.2g} % of {whole})"
        share = f"{100 * self.shares[self.terms[0]]:.0f} % of its variance"
        return f"{self.looks_like} ({share}, {100 * self.size:.2g} % of {whole})"

    def numbers(self) -> dict[str, Any]:
        """Return it for programs."""
        return {
            "looks_like": list(self.terms),
            "relative": self.relative,
            "size": self.size,
            "noise_share": self.noise,
            "shares": self.shares,
        }


def absent_terms(estimate: Estimate, added: AddedMass) -> tuple[str, ...]:
    """Names of the terms that are looked for: those with a name for it that the model lacks.

    Without gravity nothing that the joint carries weighs.
    """
    local = {name for values in estimate.local.values() for name in values}
    has = {*estimate.names, *local, *(() if added.gravity else _OF_GRAVITY)}
    named = (row.name for row in TERMS.values() if row.looks_like)
    return tuple(
        name for name in named if name not in has and not getattr(estimate.parameters, name)
    )


def slow_velocity(logs: Iterable[Log]) -> float:
    """Return the velocity in rad/s at which Stribeck friction is looked for in logs."""
    return _SLOW * float(np.median([log.rms_speed for log in logs]))


def summarise_residuals(
    balances: Sequence[ResidualEquations], least: float
) -> tuple[ResidualSummary, list[ResidualSummary]]:
    """Name what several logs leave over, together and each.

    Nothing is said below a share ``least`` of the whole. All logs have the same candidates.
    """
    weights = [1 / each.whole for each in balances]
    ends = np.cumsum([each.left.size for each in balances])[:-1]
    known, left = (
        np.concatenate([w * column for w, column in zip(weights, columns, strict=True)])
        for columns in ([each.known for each in balances], [each.left for each in balances])
    )
    names = list(balances[0].candidates)
    columns = [
        np.concatenate([w * b.candidates[name] for w, b in zip(weights, balances, strict=True)])
        for name in names
    ]
    new = np.split(_less(known, np.column_stack([left, *columns])), ends)
    noises = [w * each.noise for w, each in zip(weights, balances, strict=True)]
    sizes = [max(part.shape[0], 1) for part in new]
    noise = float(np.sqrt(np.average(np.square(noises), weights=sizes)))
    pieces = [piece for part in new for piece in np.array_split(part, _PIECES)]
    each = [
        _summarised(np.array_split(part, _PIECES), names, own, least)
        for part, own in zip(new, noises, strict=True)
    ]
    return _summarised(pieces, names, noise, least), each


def _less(known: Samples, columns: Samples) -> Samples:
    """Take from (n, j) columns what those known explain."""
    sizes = np.linalg.norm(known, axis=0)
    scaled = known[:, sizes > 0] / sizes[sizes > 0]
    change = np.linalg.lstsq(scaled, columns, rcond=_SINGULAR)[0]
    return np.asarray(columns - scaled @ change)


def _summarised(
    pieces: Sequence[Samples], names: Sequence[str], noise: float, least: float
) -> ResidualSummary:
    """Judge pieces of (n, 1 + j): what is left, and what j missing terms would change of it."""
    count = max(sum(piece.shape[0] for piece in pieces), 1)
    products = np.array([piece.T @ piece for piece in pieces])
    total = products.sum(axis=0)
    power = total[0, 0] / count
    shares: dict[str, float] = {}
    likely: dict[str, float] = {}
    for column, name in enumerate(names, start=1):
        own = total[column, column]
        if not own > 0 or not power > 0:
            continue
        value = total[column, 0] / own
        scores = products[:, column, 0] - value * products[:, column, column]
        error = float(np.sqrt(np.sum(scores**2))) / own
        shares[name] = float(value * total[column, 0] / total[0, 0])
        added = abs(value) * (own / count) ** 0.5
        possible = -value >= TERMS[name].lower
        if possible and abs(value) > _SURE * error and added > least:
            likely[name] = float(added)
    quiet = float(min(noise**2 / power, 1.0)) if power > 0 else 1.0
    ordered = dict(sorted(shares.items(), key=lambda item: -item[1]))
    enough = max(_LIKE * (1 - quiet), _ALIKE * max(shares.values(), default=0.0))
    terms = tuple(name for name in ordered if name in likely and ordered[name] > enough)
    beyond = (power * (1 - quiet)) ** 0.5 > least and quiet * _MORE_THAN_NOISE**2 < 1
    return ResidualSummary(
        relative=float(power**0.5),
        noise=quiet,
        shares=ordered,
        terms=terms,
        size=likely[terms[0]] if terms else 0.0,
        shows=bool(terms or beyond),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class CountedRun:
    """One log and its free run, where its errors count (see `first_counted`)."""

    log: Log
    setting: Setting  # what it is simulated with
    first: int  # number of the first sample that counts
    trajectory: Simulation | Segments
    motion: float  # rms of the measured angle about its mean, in rad

    @classmethod
    def of(cls, log: Log, setting: Setting) -> CountedRun:
        """Make a log ready to be simulated."""
        first = first_counted(log)
        return cls(
            log=log,
            setting=setting,
            first=first,
            trajectory=setting.simulation(log, first),
            motion=float(np.std(log.angle[first:])),
        )

    def simulated(self) -> Samples:
        """Return the simulated angles in rad at all stamps."""
        setting = self.setting
        return self.trajectory.at_stamps(setting.parameters, setting.zero, setting.velocity)


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Simulated less measured angle of one log, and its derivatives."""

    run: CountedRun
    whole: Samples  # (m,) errors in rad
    # (k, j) orthonormal directions in which the log's own start moves them, k of m after k where
    # the log is simulated in segments, each from a start of its own
    own: tuple[Samples, ...]
    shared: Samples  # (m, n) derivatives by what logs share, less those directions
    # by term that the model lacks: (m,) derivatives by it, less those directions
    missing: dict[str, Samples]
    # (m,) standard deviations in rad that the parameters' own errors give the simulated angle, to
    # first order; zeros where the estimate says nothing of them
    reach: Samples

    def less_own(self, errors: Samples) -> Samples:
        """Take from (m, k) errors what a change of the log's own start explains."""
        return less(self.own, errors)


def free_run_errors(data: DataSet, estimate: Estimate) -> list[CountedRun | Errors]:
    """Return the errors of each log's simulation and their derivatives.

    It is the run alone where a simulation fails or nothing moves.
    """
    predictor, slow = data.simulations, slow_velocity(data.logs)
    runs = [CountedRun.of(log, predictor.setting(k, estimate)) for k, log in enumerate(data.logs)]
    owners, missing = estimate.owners(data.unread), absent_terms(estimate, data.logs[0].added_mass)
    varied = _Varied(estimate.names, _root_of(estimate), owners, missing)
    return [_differentiated(run, varied, slow) or run for run in runs]


def _root_of(estimate: Estimate) -> Samples:
    """(n, n) root of the covariance, as wide as the intervals; zeros where there is none."""
    try:
        return covariance_root(honest_covariance(estimate))
    except IdentifiabilityError:
        return np.zeros((len(estimate.names),) * 2)


def less(directions: Sequence[Samples], errors: Samples) -> Samples:
    """Take from (m, k) errors the orthonormal directions of stretches, one after the other."""
    ends = np.cumsum([each.shape[0] for each in directions])[:-1]
    pairs = zip(directions, np.split(errors, ends), strict=True)
    return np.concatenate([part - each @ (each.T @ part) for each, part in pairs])


def less_shared(logs: Sequence[Errors], errors: Sequence[Samples]) -> list[Samples]:
    """Take from each log's (m, k) errors what a change of shared parameters explains, jointly.

    Each log counts as it does in output error, by the mean square of its errors over its motion.
    """
    weights = [1 / (log.run.motion * log.whole.size**0.5) for log in logs]
    rows = np.concatenate([w * log.shared for w, log in zip(weights, logs, strict=True)])
    wanted = np.concatenate([w * each for w, each in zip(weights, errors, strict=True)])
    sizes = np.linalg.norm(rows, axis=0)
    sizes[sizes == 0] = 1.0
    change = np.linalg.lstsq(rows / sizes, wanted, rcond=_INDEPENDENT)[0] / sizes[:, None]
    return [each - log.shared @ change for log, each in zip(logs, errors, strict=True)]


class _Varied(NamedTuple):
    """By what errors are differentiated.

    ``names`` of parameters that logs share, and the (n, n) ``root`` of their covariance;
    ``owners`` of those that some logs share; names of terms that are ``missing``.
    """

    names: tuple[str, ...]
    root: Samples
    owners: list[tuple[str, AddedMass | str | None]]
    missing: tuple[str, ...]


def _differentiated(run: CountedRun, varied: _Varied, slow: float) -> Errors | None:
    """Return a log's errors; None if they are no numbers, or nothing moves.

    A log's own are the velocity and the true angle at its start, which the encoder has rounded: a
    change of it moves the readings by 1 less what one of the zero does. Stribeck friction that is
    missing is looked for below the velocity ``slow``.
    """
    names, root, owners, missing = varied
    setting, log = run.setting, run.log
    parameters = setting.parameters
    if "stribeck" in missing:
        parameters = replace(parameters, stribeck_velocity=slow)
    local = dict.fromkeys(["zero", "velocity", *(name for name, _ in owners)])
    asked = [*names, *local, *missing]
    with np.errstate(all="ignore"):
        errors, rows, mixture = run.trajectory.linearised(
            asked, parameters, setting.zero, setting.velocity
        )
        slopes = dict(zip(asked, (rows @ mixture).T, strict=True))
    finite = np.isfinite(errors).all() and all(np.isfinite(each).all() for each in slopes.values())
    if not (finite and run.motion > 0):
        return None
    if isinstance(run.trajectory, Segments):
        own = run.trajectory.directions(parameters, setting.zero)
    else:
        own = (_orthonormal(np.column_stack([1 - slopes["zero"], slopes["velocity"]])),)
    mine = {None, log.added_mass, log.name}
    shared = [slopes[name] for name in names]
    shared += [slopes[name] * (whose in mine) for name, whose in owners]
    return Errors(
        run=run,
        whole=errors,
        own=own,
        shared=less(own, np.column_stack(shared)),
        missing={name: less(own, slopes[name]) for name in missing},
        reach=np.linalg.norm(np.column_stack([slopes[name] for name in names]) @ root.T, axis=1),
    )


def _orthonormal(columns: Samples) -> Samples:
    """(m, j) orthonormal columns that span those of (m, k) that are felt at all."""
    sizes = np.linalg.norm(columns, axis=0)
    felt = sizes > _INDEPENDENT * columns.shape[0] ** 0.5
    left, singular, _ = np.linalg.svd(columns[:, felt] / sizes[felt], full_matrices=False)
    return np.asarray(left[:, singular > _INDEPENDENT * singular.max(initial=0.0)])
