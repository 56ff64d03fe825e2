"""A data set made ready for estimators."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from butterfly.errors import InputError
from butterfly.identify.judgement.slips.inputs import slips_of_refused, slips_of_still
from butterfly.identify.judgement.slips.names import with_slips
from butterfly.logs.health import DEFAULT_REPAIRS, Health, Repair, examine
from butterfly.logs.log import with_unique_names
from butterfly.logs.pieces import read_logs
from butterfly.model.known import NOTHING, Knowledge, Known
from butterfly.progress import Track, untracked
from butterfly.signals.frequency_response import ResponsePoint, response_point

if TYPE_CHECKING:
    from collections.abc import Sequence

    from butterfly.logs.log import InputKind, Log
    from butterfly.logs.manifest import Manifest
    from butterfly.model.parameters import AddedMass, JointKind

_UPRIGHT = 0.9 * math.pi  # rad from the rest angle


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DataSet:
    """Logs and what was read off them.

    Parameters
    ----------
    name, description
        Of the data set.
    manifest
        What it was read by; None if its logs came from no files.
    input_kind
        What its input commands.
    known
        What is known of the robot.
    recorded
        The logs as they were recorded.
    logs, health
        The logs, repaired, and the record of what was found in each.
    points
        The steady response of each log, None where the input is no sine.
    """

    name: str
    description: str
    manifest: Manifest | None = None
    input_kind: InputKind
    known: Knowledge = NOTHING
    recorded: tuple[Log, ...]
    logs: tuple[Log, ...]
    health: tuple[Health, ...]
    points: tuple[ResponsePoint | None, ...]

    @classmethod
    def of(
        cls,
        recorded: Sequence[Log],
        *,
        name: str = "logs",
        description: str = "",
        manifest: Manifest | None = None,
        known: Knowledge = NOTHING,
        repairs: frozenset[Repair] = DEFAULT_REPAIRS,
        track: Track = untracked,
    ) -> DataSet:
        """Check and repair logs, and fit the steady response of those whose input is a sine.

        Raises
        ------
        InputError
            If there is no log, one cannot be used, or their inputs are of different kinds.
        """
        if not recorded:
            raise InputError(name, "logs", "none", "at least one log")
        kinds = sorted({log.input_kind for log in recorded})
        if len(kinds) > 1:
            raise InputError(name, "input", " and ".join(kinds), "one kind of input in all logs")
        joints = sorted({(log.added_mass.joint, log.added_mass.gravity) for log in recorded})
        if len(joints) > 1:
            raise InputError(name, "gravity", "different ones", "one joint under one gravity")
        recorded = with_unique_names(recorded)
        try:
            examined = [examine(log, repairs) for log in recorded]
        except InputError as error:
            raise with_slips(error, slips_of_still(recorded)) from None
        logs = [log for log, _ in examined]
        return cls(
            name=name,
            description=description,
            manifest=manifest,
            input_kind=recorded[0].input_kind,
            known=_of_joint(recorded[0]).also(known),
            recorded=tuple(recorded),
            logs=tuple(logs),
            health=tuple(health for _, health in examined),
            points=_responses(logs, track),
        )

    @property
    def sines(self) -> list[ResponsePoint]:
        """The responses of the logs that have one."""
        return [point for point in self.points if point is not None]

    @property
    def masses(self) -> list[AddedMass]:
        """The different added masses."""
        return sorted({log.added_mass for log in self.logs})

    @property
    def joint(self) -> JointKind:
        """How the joint moves."""
        return self.logs[0].added_mass.joint

    @cached_property
    def equilibria(self) -> dict[AddedMass, float]:
        """Encoder reading in rad of the hand at rest, for each added mass.

        It is the median of its logs' mean angles; readings that are whole turns apart are the same.
        A log in which the hand turns round tells where it began, if there is no other.
        """
        turning = [float(np.ptp(log.angle)) > 2 * np.pi for log in self.logs]
        middles = [
            float(log.angle[0]) if turns else _middle(log, point)
            for log, point, turns in zip(self.logs, self.points, turning, strict=True)
        ]
        home = middles[turning.index(False)] if False in turning else middles[0]
        rests: dict[AddedMass, list[float]] = {}
        for mass in self.masses:
            own = [k for k, log in enumerate(self.logs) if log.added_mass == mass]
            told = [k for k in own if not turning[k]] or own
            rests[mass] = [home + math.remainder(middles[k] - home, 2 * np.pi) for k in told]
        return {mass: float(np.median(angles)) for mass, angles in rests.items()}

    @cached_property
    def calm(self) -> list[int]:
        """Numbers of the logs in which the hand stays away from the upright."""
        zeros = self.equilibria
        return [k for k, log in enumerate(self.logs) if not turns_over(log, zeros[log.added_mass])]

    def __repr__(self) -> str:
        return (
            f"DataSet({self.name!r}: {len(self.logs)} logs with {len(self.masses)} added masses, "
            f"{self.input_kind})"
        )

    def knowing(self, known: Knowledge) -> DataSet:
        """Return the data set of a robot of which more is known."""
        if not known:
            return self
        manifest = None if self.manifest is None else self.manifest.knowing(known)
        return replace(self, known=self.known.also(known), manifest=manifest)

    def take(self, rows: Sequence[int]) -> DataSet:
        """Return the data set of some logs, by their numbers."""
        return replace(
            self,
            manifest=self._part(rows),
            recorded=tuple(self.recorded[k] for k in rows),
            logs=tuple(self.logs[k] for k in rows),
            health=tuple(self.health[k] for k in rows),
            points=tuple(self.points[k] for k in rows),
        )

    def _part(self, rows: Sequence[int]) -> Manifest | None:
        if self.manifest is None:
            return None
        entries = [self.manifest.logs[k] for k in rows]
        return self.manifest.model_copy(update={"logs": entries})


def _of_joint(log: Log) -> Knowledge:
    """Tell what follows from how a joint moves: across no gravity there is no moment."""
    return NOTHING if log.added_mass.gravity else Knowledge(parameters={"p3": Known(value=0.0)})


def _middle(log: Log, point: ResponsePoint | None) -> float:
    return float(np.mean(log.angle)) if point is None else point.angle.offset


def turns_over(log: Log, zero: float) -> bool:
    """Whether the hand passes near the upright, or through it, so that small causes tell.

    Parameters
    ----------
    log
        Of any input.
    zero
        Encoder reading in rad of the hand at rest.
    """
    turned = 2 * math.pi * round((float(np.median(log.angle)) - zero) / (2 * math.pi))
    return bool(np.max(np.abs(log.angle - zero - turned)) > _UPRIGHT)


def _responses(logs: Sequence[Log], track: Track) -> tuple[ResponsePoint | None, ...]:
    """Fit the steady response of each sine; a refusal names the slip that explains it."""
    try:
        return tuple(
            response_point(log) if log.excitation else None for log in track(logs, "Fitting sines")
        )
    except InputError as error:
        raise with_slips(error, slips_of_refused(logs)) from None


def read_data_set(manifest: Manifest, track: Track = untracked) -> DataSet:
    """Read every log of a manifest (see `DataSet.of`).

    Raises
    ------
    InputError
        If a log cannot be read or used.
    """
    manifest, recorded = read_logs(manifest, track)
    return DataSet.of(
        recorded,
        name=manifest.name,
        description=manifest.description,
        manifest=manifest,
        known=manifest.knowledge,
        repairs=frozenset(manifest.repair),
        track=track,
    )
