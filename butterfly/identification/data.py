"""A data set made ready for estimators."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.identification.consistency import is_driven
from butterfly.identification.derived_quantities import implied, relaxed_for_masses
from butterfly.identification.free_run import Simulations, turns_over
from butterfly.identification.segments import driven
from butterfly.identification.trust import FEW, LOST, Finding
from butterfly.identification.unit_errors import (
    unit_errors_of_refused,
    unit_errors_of_still,
    with_unit_errors,
)
from butterfly.identification.weak_regression import (
    EncoderOffset,
    OffsetKind,
    encoder_offsets,
    near,
    reading_of,
)
from butterfly.logs.health import DEFAULT_REPAIRS, GLANCE, Health, Repair, examine, thinned
from butterfly.logs.log import InputKind, Log
from butterfly.logs.manifest import Manifest
from butterfly.logs.motors import require_drive
from butterfly.logs.reading import numbers_named, read_logs, with_unique_names
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.model.prior import NO_PRIOR, Known, Prior
from butterfly.model.terms import OF_ANGLE, TERMS
from butterfly.progress import Track, untracked
from butterfly.signals.frequency_response import ResponsePoint, response_point

_DRIFT = 0.5  # of the amplitude, by which a steady sine drifts at most

LARGEST_SINE = math.pi / 2
"""In rad, beyond which the steady response to a sine is no sine any more, even nearly."""

_OF_EACH_LOG = ("recorded", "logs", "health", "points")  # of a data set


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DataSet:
    """Logs, checked and repaired, ready for an estimator.

    Parameters
    ----------
    name, description
        Of the data set.
    manifest
        The manifest it was read from; None if the logs came from no files.
    input_kind
        Kind of input.
    given
        Known values, as given.
    known
        The same, with the parameters that follow from them.
    recorded
        The logs as recorded.
    logs, health
        The logs, repaired and, if very long, thinned (see `butterfly.logs.health`), and the
        findings on each.
    points
        The steady response of each log; None if its input is not a sine.
    test_logs
        Held-out logs, which are predicted but not fitted; None if there are none.
    correction
        Correction of ``logs`` in addition to repairs, if any.
    remarks
        Findings on the logs that every answer from them repeats.
    taken_off
        (n,) input that the motion of other joints took, which ``logs`` are without, by log.
    """

    name: str
    description: str
    manifest: Manifest | None = None
    input_kind: InputKind
    given: Prior = NO_PRIOR
    known: Prior = NO_PRIOR
    recorded: tuple[Log, ...]
    logs: tuple[Log, ...]
    health: tuple[Health, ...]
    points: tuple[ResponsePoint | None, ...]
    test_logs: DataSet | None = None
    correction: Finding | None = None
    remarks: tuple[Finding, ...] = ()
    taken_off: Mapping[str, Samples] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        recorded: Sequence[Log],
        *,
        name: str = "logs",
        description: str = "",
        known: Prior = NO_PRIOR,
        repairs: frozenset[Repair] = DEFAULT_REPAIRS,
        track: Track = untracked,
    ) -> DataSet:
        """Check and repair logs, and fit the steady response of those whose input is a sine.

        InputError if there is no log, one is unusable, or they are of different kinds.
        """
        if not recorded:
            raise InputError(name, "logs", "none", "at least one log")
        joints = sorted({(log.added_mass.joint, log.added_mass.gravity) for log in recorded})
        if len(joints) > 1:
            raise InputError(
                name, "gravity", "different values", "the same joint and gravity in all logs"
            )
        recorded = with_unique_names(recorded)
        try:
            examined = [examine(log, repairs) for log in recorded]
        except InputError as error:
            raise with_unit_errors(error, unit_errors_of_still(recorded)) from None
        logs = [thinned(driven(log)) for log, _ in examined]
        kinds = sorted({log.input_kind for log in logs} - {InputKind.NONE})
        if len(kinds) > 1:
            raise InputError(
                name, "input", " and ".join(kinds), "the same kind of input in all logs"
            )
        given, kind = _of_loops(logs) | known, kinds[0] if kinds else InputKind.NONE
        require_drive(given, kind, logs[0].added_mass.joint, name)
        return cls(
            name=name,
            description=description,
            input_kind=kind,
            given=given,
            known=_implied(given, logs),
            recorded=tuple(recorded),
            logs=tuple(logs),
            health=tuple(health for _, health in examined),
            points=_responses(logs, track),
        )

    @property
    def assumed(self) -> dict[str, str]:
        """Reasons, by name, for parameters assumed to be 0 although they were not given."""
        return {
            name: why for name, why in _absent(self.logs).items() if name not in self.given.values
        }

    @property
    def about(self) -> dict[str, Any]:
        """Description of the data, as every result has it."""
        carrier = self.logs[0].added_mass
        return {
            "name": self.name,
            "description": self.description,
            "input": str(self.input_kind),
            "logs": len(self.logs),
            "added_masses": [str(mass) for mass in self.masses],
            "known": self.known.to_dict(),
            "joint": str(carrier.joint),
            "gravity": carrier.gravity,
        }

    @property
    def sines(self) -> list[ResponsePoint]:
        """Steady responses of the sine logs."""
        return [point for point in self.points if point is not None]

    @property
    def masses(self) -> list[AddedMass]:
        """The different added masses."""
        return sorted({log.added_mass for log in self.logs})

    @cached_property
    def steady(self) -> list[int]:
        """Indices of the logs whose response to a sine is a steady swing about the rest angle."""
        return [k for k in range(len(self.logs)) if self._is_steady(k)]

    def _is_steady(self, number: int) -> bool:
        log, point = self.logs[number], self.points[number]
        if point is None:
            return False
        away = math.remainder(point.angle.offset - self.zero_of(log), 2 * math.pi)
        return bool(
            0 < point.amplitude <= LARGEST_SINE
            and float(np.ptp(log.angle)) / 2 <= math.pi / 2 + LARGEST_SINE
            and not point.angle.residual_rms * math.sqrt(2) > LOST * point.amplitude
            and not abs(point.drift) > _DRIFT
            and (abs(away) < LARGEST_SINE / 2 or not self.hangs)
        )

    @property
    def joint(self) -> JointKind:
        """How the joint moves."""
        return self.logs[0].added_mass.joint

    @cached_property
    def glance(self) -> tuple[Log, ...]:
        """The logs, thinned for a first look."""
        return tuple(thinned(log, GLANCE) for log in self.logs)

    @cached_property
    def offsets(self) -> tuple[EncoderOffset, ...]:
        """Encoder reading where the model's angle is 0, for each log, and how it was found.

        InputError if a term needs the angle, and a log has only a velocity.
        """
        known = self.known.parameters.items()
        acting = [name for name, value in known if name in OF_ANGLE and value != Known(value=0.0)]
        if acting or self.hangs:
            self.require_angles((*acting, "gravity")[0])
        return encoder_offsets(self.logs, self.points)

    @cached_property
    def equilibria(self) -> dict[AddedMass, float]:
        """Encoder reading in rad where the model's angle is 0, for each added mass.

        It is the median of its logs' zeros; a known zero of a single log takes precedence (see
        `zero_of`).
        """
        zeros: dict[AddedMass, float] = {}
        for mass in self.masses:
            pairs = zip(self.logs, self.offsets, strict=True)
            of_mass = [zero for log, zero in pairs if log.added_mass == mass]
            others = [zero for zero in of_mass if zero.kind is not OffsetKind.GIVEN] or of_mass
            zeros[mass] = float(np.median([near(zero.value, others[0].value) for zero in others]))
        return zeros

    def zero_of(self, log: Log) -> float:
        """Return the encoder reading in rad where the model's angle is 0 in one of the logs."""
        return reading_of(log, self.equilibria)

    @cached_property
    def simulations(self) -> Simulations:
        """Simulations of the logs, with a cache of their free runs."""
        return Simulations(self.logs, self.equilibria, self.counted)

    @property
    def hangs(self) -> bool:
        """Whether gravity acts on the joint, so that it has a rest angle; true if unknown."""
        return not self.known.weightless(self.masses)

    @property
    def unread(self) -> list[AddedMass]:
        """Added masses with logs whose zero is not known exactly; none without gravity."""
        open_ = {log.added_mass for log in self.logs if log.zero is None or not log.zero.fixed}
        return sorted(open_) if self.hangs else []

    @property
    def guessed(self) -> tuple[str, ...]:
        """Names of the logs whose zero is a guess; none without gravity."""
        pairs = zip(self.logs, self.offsets, strict=True) if self.hangs else ()
        return tuple(log.name for log, zero in pairs if zero.kind is OffsetKind.GUESS)

    @cached_property
    def counted(self) -> list[int]:
        """Indices of the logs in which the hand stays away from the upright; all, if none does.

        Near it the motion is sensitive to its start.
        """
        every = list(range(len(self.logs)))
        if not self.hangs:
            return every
        pairs = enumerate(self.logs)
        away = [k for k, log in pairs if log.closed or not turns_over(log, self.zero_of(log))]
        return away or every

    @property
    def calm(self) -> DataSet:
        """The logs that stay away from the upright, if there are enough to stand for all."""
        calm = self.take(self.counted)
        few = len(calm.masses) <= 1 or len(calm.logs) <= FEW
        return self if few or len(calm.logs) == len(self.logs) else calm

    def require_angles(self, *needed: str) -> None:
        """Raise InputError if something needs the angle, and a log has only a velocity."""
        log = next((log for log in self.recorded if log.integrated), None)
        if log is not None and needed:
            expected = (
                f"an angle, which {needed[0]} needs (without gravity, weak-form and output-error "
                "need none: --gravity 0, --joint slide, or --known p3=0 for a balanced joint)"
            )
            raise InputError(log.source, "angle", "only a velocity", expected)

    def __repr__(self) -> str:
        return (
            f"DataSet({self.name!r}: {len(self.logs)} logs with {len(self.masses)} added masses, "
            f"{self.input_kind})"
        )

    def knowing(self, known: Prior) -> DataSet:
        """Return the data set with further known values."""
        if not known:
            return self
        given = self.given | known
        require_drive(given, self.input_kind, self.joint, self.name)
        return replace(
            self,
            given=given,
            known=_implied(given, self.logs),
            manifest=self.manifest and self.manifest.knowing(known),
            test_logs=self.test_logs and self.test_logs.knowing(known),
        )

    def with_zero(self, zero: Known) -> DataSet:
        """Return the data set with the encoder reading in rad where the hand hangs."""
        return replace(
            self,
            manifest=self.manifest and self.manifest.with_zero(zero),
            recorded=tuple(replace(log, zero=zero) for log in self.recorded),
            logs=tuple(replace(log, zero=zero) for log in self.logs),
            test_logs=self.test_logs and self.test_logs.with_zero(zero),
        )

    def corrected(self, correct: Callable[[Log], Log], finding: Finding | None = None) -> DataSet:
        """Return the data set with every log corrected, held-out ones too, with its finding."""
        logs, correction = tuple(map(correct, self.logs)), finding or self.correction
        held = self.test_logs and self.test_logs.corrected(correct, finding)
        points = _responses(logs, untracked)
        return replace(self, logs=logs, points=points, test_logs=held, correction=correction)

    def annotated(self, tell: Callable[[Log], Log]) -> DataSet:
        """Return the data set with ``tell`` applied to every log; it must change no response."""
        held = self.test_logs and self.test_logs.annotated(tell)
        return replace(self, logs=tuple(map(tell, self.logs)), test_logs=held)

    @property
    def whole(self) -> DataSet:
        """The data set of all logs, held-out ones last, which its manifest names."""
        held, manifest = self.test_logs, self.manifest
        if held is None:
            return self
        if manifest is not None and held.manifest is not None:
            entries, names = [*manifest.logs, *held.manifest.logs], [log.name for log in held.logs]
            manifest = manifest.model_copy(update={"logs": entries, "holdout": names})
        both: dict[str, Any]
        both = {name: (*getattr(self, name), *getattr(held, name)) for name in _OF_EACH_LOG}
        return replace(self, manifest=manifest, test_logs=None, **both)

    def holding_out(self, names: Sequence[str]) -> DataSet:
        """Return the data set with some logs, by name or glob pattern, as `test_logs`.

        InputError if there is no such log, or none remains.
        """
        return self.holding(numbers_named(self.logs, names, self.name)) if names else self

    def holding(self, rows: Sequence[int]) -> DataSet:
        """Return the data set with some logs, by their numbers, as `test_logs` (if any is left)."""
        if not rows:
            return self
        whole, count = self.whole, len(self.logs)
        numbers = [k for k in range(count) if k not in rows]
        if not numbers:
            raise InputError(self.name, "holdout", "all logs", "at least one log to estimate from")
        test_logs = whole.take([*rows, *range(count, len(whole.logs))])
        return replace(whole.take(numbers), test_logs=test_logs)

    def take(self, rows: Sequence[int]) -> DataSet:
        """Return the data set of some of the logs that are used, by their numbers."""
        manifest = self.manifest
        if manifest is not None:
            entries = [manifest.logs[k] for k in rows]
            manifest = manifest.model_copy(update={"logs": entries, "holdout": []})
        some: dict[str, Any]
        some = {name: tuple(getattr(self, name)[k] for k in rows) for name in _OF_EACH_LOG}
        return replace(self, manifest=manifest, test_logs=None, **some)


def _absent(logs: Sequence[Log]) -> dict[str, str]:
    """Return why logs show none of some parameters, by name."""
    missing = {
        "gravity": ("no gravity acts", not logs[0].added_mass.gravity),
        "angle": ("a log has only a velocity", any(log.integrated for log in logs)),
        "drive": ("nothing drives", not is_driven(logs)),
        "input": ("no input", all(log.input_kind is InputKind.NONE for log in logs)),
    }
    reasons = {need: reason for need, (reason, is_missing) in missing.items() if is_missing}
    return {row.name: reasons[row.needs] for row in TERMS.values() if row.needs in reasons}


def _of_loops(logs: Sequence[Log]) -> Prior:
    """Return the gains of servo loops that were given with an uncertainty."""
    loops = [log.servo.uncertain for log in logs if log.servo]
    return Prior({name: gain for loop in loops for name, gain in loop.items()})


def _implied(given: Prior, logs: Sequence[Log]) -> Prior:
    """Return the given prior with the parameters that follow from it and some logs."""
    given, first = Prior(dict.fromkeys(_absent(logs), Known(value=0.0))) | given, logs[0]
    moment = given.parameters.get("p3")
    if moment is not None and moment != Known(value=0.0) and not first.added_mass.gravity:
        raise InputError("known", "p3", moment, "0, as no gravity acts on this joint")
    known = implied(given, first.input_kind, first.added_mass.joint)
    return relaxed_for_masses(known, [log.added_mass for log in logs])


def _responses(logs: Sequence[Log], track: Track) -> tuple[ResponsePoint | None, ...]:
    """Fit the steady response of each sine; errors name the unit error that explains them."""
    try:
        return tuple(
            response_point(log) if log.excitation and not log.integrated else None
            for log in track(logs, "Fitting sines")
        )
    except InputError as error:
        raise with_unit_errors(error, unit_errors_of_refused(logs)) from None


def read_data_set(manifest: Manifest, track: Track = untracked) -> DataSet:
    """Read every log of a manifest (see `DataSet.of`)."""
    manifest, recorded = read_logs(manifest, track)
    data = DataSet.of(
        recorded,
        name=manifest.name,
        description=manifest.description,
        known=manifest.prior,
        repairs=frozenset(manifest.repair),
        track=track,
    )
    return replace(data, manifest=manifest).holding_out(manifest.holdout)
