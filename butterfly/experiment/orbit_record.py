"""What is kept of an orbit that was held."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import TypeAdapter

from butterfly.identification.parameter import or_none
from butterfly.orbit.study import OrbitStudy


@dataclass(frozen=True, kw_only=True)
class CrossRecord:
    """Models of orbits, used at each other's: amplitudes in rad, rms errors in rad by row."""

    amplitudes_rad: tuple[float, ...]
    rms_rad: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, kw_only=True)
class OrbitRecord:
    """An orbit that was held, and the re-calibration next to it.

    Parameters
    ----------
    target_rad
        Amplitude that was wanted.
    amplitudes_rad
        Those that the rounds came to; None where the hand turned over.
    ending
        Why the rounds ended, in words.
    absolute
        Whether the parameters are, or ratios to p1.
    free_run_rms_rad
        Errors of the models' free runs, by model.
    cross_orbit
        Errors of models at each other's orbits.
    verdict
        What may be done with the parameters; None in records of older programs.
    """

    target_rad: float
    amplitudes_rad: tuple[float | None, ...]
    ending: str
    absolute: bool
    free_run_rms_rad: dict[str, float]
    cross_orbit: CrossRecord
    verdict: str | None = None

    @classmethod
    def of(cls, study: OrbitStudy) -> OrbitRecord:
        """Return the record of a study."""
        rounds = study.calibration.rounds
        last = rounds[-1].recalibration
        return cls(
            target_rad=rounds[-1].wanted,
            amplitudes_rad=tuple(or_none(each.amplitude) for each in rounds),
            ending=study.calibration.ending,
            absolute=last.is_absolute,
            verdict=study.estimate.level.verdict,
            free_run_rms_rad=study.errors,
            cross_orbit=CrossRecord(
                amplitudes_rad=study.amplitudes,
                rms_rad=tuple(tuple(row) for row in study.cross.tolist()),
            ),
        )

    @property
    def rounds(self) -> int:
        """How many rounds were made."""
        return len(self.amplitudes_rad)

    @property
    def amplitude_rad(self) -> float | None:
        """That of the last round."""
        return self.amplitudes_rad[-1]

    @property
    def generic_rms_rad(self) -> float | None:
        """Error of the model that the rounds began with."""
        return self.free_run_rms_rad.get("generic")

    @property
    def recalibrated_rms_rad(self) -> float | None:
        """Error of the model that they came to."""
        return self.free_run_rms_rad.get("re-calibrated")

    def numbers(self) -> dict[str, Any]:
        """Return what it says besides the verdict, for programs."""
        numbers: dict[str, Any] = _ORBIT.dump_python(self, mode="json", exclude={"verdict"})
        return numbers


_ORBIT = TypeAdapter(OrbitRecord)
