"""The residuals of output error: all logs simulated freely, their parameters of several owners."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from butterfly.identify.free_run import Trajectory
from butterfly.model.kinematics import Motion
from butterfly.model.terms import PARAMETERS, TERMS, lower_bounds

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from butterfly.logs.log import Log
    from butterfly.model.parameters import AddedMass, LumpedParameters

    Key = tuple[str, AddedMass | str | None]  # a parameter, and whose it is: all logs', if None

_T = TypeVar("_T")

LOCAL = ("zero", "bias", "velocity")
"""What may differ from mass to mass or from log to log."""

_STEP = 1e-4  # of the differences, as a share of a parameter's scale
_DOUBTFUL = 5e-3  # share of the largest singular value below which a combination is looked at again
_LOOKS = 2  # each squares the share by which a combination without effect seems to have one
_PHASES = np.linspace(0, 2 * np.pi, 400)


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What is fitted.

    Parameters
    ----------
    terms, fixed, per_mass, per_log, window
        See `butterfly.identify.estimators.output_error.OutputError`.
    workers
        Threads.
    """

    terms: tuple[str, ...]
    fixed: tuple[str, ...]
    per_mass: tuple[str, ...]
    per_log: tuple[str, ...]
    window: float
    workers: int

    @property
    def shared(self) -> tuple[str, ...]:
        """Names of the parameters that all logs share, the encoder's zero aside."""
        owned = {*self.fixed, *self.per_mass, *self.per_log}
        return tuple(name for name in (*PARAMETERS, *self.terms) if name not in owned)


@dataclass(frozen=True, eq=False)
class LogResiduals:
    """One log's (m,) residuals and their (m, n) derivatives by the n scaled parameters."""

    residuals: NDArray[np.float64]
    jacobian: NDArray[np.float64]


class FreeRunResiduals:
    """Residuals and Jacobian of a set of logs, in parameters scaled to be of order 1.

    Parameters
    ----------
    logs
        The logs, each of a name of its own.
    start
        First guess of the parameters, and the values of those that are not fitted.
    zeros
        First guess of the encoder's reading in rad of the hand at rest, per added mass.
    choice
        What is fitted.
    """

    def __init__(
        self,
        logs: Sequence[Log],
        start: LumpedParameters,
        zeros: Mapping[AddedMass, float],
        choice: Choice,
    ) -> None:
        self.logs, self.start, self._zeros = logs, start, zeros
        self._workers = choice.workers
        self.names = choice.shared
        self.keys = [*((name, None) for name in self.names), *_local_keys(logs, choice)]
        scales = _scales(logs, start)
        self.scale = np.array([scales[name] for name, _ in self.keys])
        self.lower = np.asarray(lower_bounds([name for name, _ in self.keys]) / self.scale)
        self.initial = np.array([self._first_guess(*key) for key in self.keys]) / self.scale
        first = [_first_sample(log, choice.window) for log in logs]
        self._trajectories = [Trajectory(log, start, k) for log, k in zip(logs, first, strict=True)]
        self._motion = [float(np.std(log.angle[k:])) for log, k in zip(logs, first, strict=True)]

    def residuals(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """Errors of all logs relative to their rms motion; a log's squares sum to their mean."""
        values = scaled * self.scale
        return np.concatenate(self._over_logs(lambda k: self._errors(k, values)))

    def jacobian(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """All logs' Jacobians, one below another, by one-sided differences."""
        values = scaled * self.scale
        return np.concatenate(self._over_logs(lambda k: self._differentiate(k, values)))

    def by_log(self, scaled: NDArray[np.float64]) -> list[LogResiduals]:
        """Return residuals and Jacobian of each log.

        Combinations that the data tell little about are differentiated once more as a whole: only
        this tells columns that the data cannot tell apart from columns that they can hardly.
        """
        values = scaled * self.scale
        logs = self._over_logs(
            lambda k: LogResiduals(self._errors(k, values), self._differentiate(k, values))
        )
        for _ in range(_LOOKS):
            jacobian = np.concatenate([log.jacobian for log in logs])
            for direction, share in self._doubtful(jacobian, values):
                slopes = self._slopes_along(direction, values)
                logs = [
                    replace(
                        log, jacobian=log.jacobian + np.outer(s - log.jacobian @ direction, share)
                    )
                    for log, s in zip(logs, slopes, strict=True)
                ]
        return logs

    def _over_logs(self, work: Callable[[int], _T]) -> list[_T]:
        with ThreadPoolExecutor(self._workers) as pool:
            return list(pool.map(work, range(len(self.logs))))

    def _first_guess(self, name: str, whose: AddedMass | str | None) -> float:
        if name != "zero":
            guess = float(getattr(self.start, name, 0.0))
            lost = guess == 0 and name in TERMS and not TERMS[name].sign_observable
            # Where the sign does not show the derivative is 0 at 0: the fit would stay there.
            return self.scale[self.keys.index((name, whose))] if lost else guess
        masses = {log.added_mass for log in self.logs if whose in {None, log.added_mass, log.name}}
        return float(np.median([self._zeros[mass] for mass in masses]))

    def _errors(self, index: int, values: NDArray[np.float64]) -> NDArray[np.float64]:
        log = self.logs[index]
        own = {self.keys[k][0]: float(values[k]) for k in self._columns(log)}
        errors = self._trajectories[index].errors(
            zero=own.pop("zero"),
            velocity=own.pop("velocity", 0.0),
            parameters=replace(self.start, **own),
        )
        return np.asarray(errors / (self._motion[index] * errors.size**0.5))

    def _differentiate(self, index: int, values: NDArray[np.float64]) -> NDArray[np.float64]:
        residuals = self._errors(index, values)
        jacobian = np.zeros((residuals.size, len(self.keys)))
        for k in self._columns(self.logs[index]):
            moved = values.copy()
            moved[k] += _STEP * self.scale[k]
            jacobian[:, k] = (self._errors(index, moved) - residuals) / _STEP
        return jacobian

    def _doubtful(
        self, jacobian: NDArray[np.float64], values: NDArray[np.float64]
    ) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Return the directions, in scaled parameters, along which a Jacobian is small.

        Each with the (n,) vector that reads its share off a move; parameters on a bound stay.
        """
        free = values / self.scale - _STEP >= self.lower
        size = np.linalg.norm(jacobian, axis=0)
        size[size == 0] = 1.0
        columns = jacobian[:, free] / size[free]
        _, singular, right = np.linalg.svd(columns, full_matrices=False)
        found = []
        for row in right[singular < _DOUBTFUL * singular[0]]:
            direction, share = np.zeros(free.size), np.zeros(free.size)
            direction[free], share[free] = row / size[free], row * size[free]
            longest = float(np.abs(direction).max())
            found.append((direction / longest, share * longest))
        return found

    def _slopes_along(
        self, direction: NDArray[np.float64], values: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        """Return the derivative of each log's residuals along a direction, by central differences.

        Differences along the axes leave 1e-6 to 1e-5 of their columns, where a reversal moves from
        one step of the simulation to the next; along a combination without effect nothing moves.
        """
        step = _STEP * self.scale * direction
        return self._over_logs(
            lambda k: (
                (self._errors(k, values + step) - self._errors(k, values - step)) / (2 * _STEP)
            )
        )

    def _columns(self, log: Log) -> list[int]:
        """Numbers of the parameters that concern one log."""
        owners = {None, log.added_mass, log.name}
        return [k for k, (_, whose) in enumerate(self.keys) if whose in owners]


def _local_keys(logs: Sequence[Log], choice: Choice) -> list[Key]:
    masses = sorted({log.added_mass for log in logs})
    keys: list[Key] = [(name, mass) for name in choice.per_mass for mass in masses]
    different = list(dict.fromkeys(log.name for log in logs))
    keys += [(name, log) for name in choice.per_log for log in different]
    if "zero" not in {*choice.per_mass, *choice.per_log}:
        keys.append(("zero", None))
    return keys


def _first_sample(log: Log, window: float) -> int:
    if log.excitation is None:
        return 0
    return int(np.searchsorted(log.time, log.time[-1] - window))


def _scales(logs: Sequence[Log], start: LumpedParameters) -> dict[str, float]:
    """Size of each parameter whose torque would be a tenth of the motor's, as large for p1 and p3.

    The torque per unit is the largest that a typical swing takes from the table of terms.
    """
    swing = float(np.median([np.std(log.angle) for log in logs]))
    command = float(np.median([1.0, *(np.std(log.input) for log in logs)]))
    rate = float(np.median([log.excitation.omega for log in logs if log.excitation] or [5.0]))
    inertia = abs(start.p1) + max(log.added_mass.inertia for log in logs)
    torque, speed = inertia * swing * rate**2, swing * rate
    weight = max([1e-3, *(log.added_mass.weight for log in logs)])
    angle, velocity = swing * np.sin(_PHASES), speed * np.cos(_PHASES)
    motion = Motion.of(start, angle, velocity, weight=weight)
    sizes = {
        "p1": inertia,
        "p3": torque / swing,
        "p4": abs(start.p4) or torque / command,
        "zero": swing,
        "velocity": speed,
    }
    for row in TERMS.values():
        if row.size is not None:
            sizes.setdefault(row.name, row.size(speed, rate))
        elif row.basis is not None and not row.of_gain and row.name not in sizes:
            sizes[row.name] = 0.1 * torque / float(np.abs(row.basis(motion)).max())
    return sizes
