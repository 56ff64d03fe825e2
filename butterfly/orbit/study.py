"""How much better the re-calibrated model is next to the orbit, and how far from it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.diagnostics.plausibility import judge_fit
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FreeRun, Setting
from butterfly.logs.log import Log
from butterfly.model.energy import Orbit
from butterfly.model.parameters import NO_ADDED_MASS, LumpedParameters
from butterfly.orbit.controller import Dithered
from butterfly.orbit.loop import Calibration, OrbitSchedule, RunLaw, calibrate
from butterfly.orbit.recalibration import RecalibrationOptions, recalibrate
from butterfly.progress import Track, untracked

PERIODS = 5
"""Length of the free runs that are compared, in periods of the orbit."""

_BESIDE = 1.08  # amplitude over the orbit's, at which a held-out run starts
_DITHER = 0.2  # of a held-out run
_HANGING = 1e-3  # rad, of a swing as long as that of a hand that begins where it hangs
_AROUND = (1.0, 0.8, 1.2)  # amplitudes over the orbit's, at which runs for its calibration start


@dataclass(frozen=True, kw_only=True, eq=False)
class OrbitStudy:
    """A calibration, and how well its model predicts runs that it has not seen."""

    name: str
    description: str
    zero: float  # encoder reading in rad of the hanging hand
    generic: LumpedParameters  # of the loaded hand, that the loop began with
    calibration: Calibration
    held_out: Log  # a run next to the orbit that was used for nothing else
    estimate: Estimate  # of the last round, with what its free run of that log says
    small_swings: Estimate | None  # that it began with; None if parameters were given
    errors: dict[str, float]  # rms in rad over `PERIODS`, by model: "generic", "re-calibrated"
    amplitudes: tuple[float, ...]  # (n,) in rad, of the orbits of the next
    cross: NDArray[np.float64]  # (n, n) rms in rad of the row's model at the column's orbit


def study_orbit(
    rig: RunLaw,
    believed: LumpedParameters,
    zero: float,
    schedule: OrbitSchedule,
    options: RecalibrationOptions,
    *,
    amplitudes: tuple[float, ...] = (),
    small_swings: Estimate | None = None,
    rng: np.random.Generator,
    name: str = "orbit",
    description: str = "",
    track: Track = untracked,
) -> OrbitStudy:
    """Calibrate, and compare free runs of the generic and the re-calibrated model.

    ``believed`` are parameters of the bare hand, from ``small_swings`` if they were identified;
    ``zero`` is the encoder reading in rad of the hanging hand. At the orbits of the ``amplitudes``
    in rad models are re-calibrated and used crosswise.
    """
    calibration = calibrate(rig, believed, zero, schedule, options, rng=rng, track=track)
    carried = schedule.added_masses[0]
    final = calibration.parameters

    def run(amplitude: float, start: float, dither: float) -> Log:
        orbit = Orbit.of_amplitude(final, amplitude)
        law = Dithered(schedule.law(orbit, zero), dither, 2 * np.pi / orbit.period, rng)
        return rig(law, start, schedule.duration, carried)

    last, generic = calibration.rounds[-1], calibration.rounds[0].believed
    nominal = last.orbit.upper
    held_out = run(nominal, _BESIDE * nominal, _DITHER)
    runs = {
        name: beside_orbit(held_out, model, zero)
        for name, model in (("generic", generic), ("re-calibrated", final))
    }
    followed = judge_fit(np.array([runs["re-calibrated"].fit]), ["next to the orbit"])
    fresh, models_at = [], []
    for amplitude in track(amplitudes, "Cross-checking orbits"):
        fresh.append(run(amplitude, _BESIDE * amplitude, _DITHER))
        logs = [run(amplitude, share * amplitude, _DITHER) for share in _AROUND]
        models_at.append(recalibrate(logs, zero, options).loaded(carried, final.p1))
    return OrbitStudy(
        name=name,
        description=description,
        zero=zero,
        generic=generic,
        calibration=calibration,
        held_out=held_out,
        estimate=last.recalibration.estimate.with_findings(*followed),
        small_swings=small_swings,
        errors={name: run.rms for name, run in runs.items()},
        amplitudes=amplitudes,
        cross=np.array(
            [[beside_orbit(log, model, zero).rms for log in fresh] for model in models_at]
        ).reshape(len(amplitudes), len(amplitudes)),
    )


def beside_orbit(
    log: Log, loaded: LumpedParameters, zero: float, periods: float = PERIODS
) -> FreeRun:
    """Return a free run from the log's first sample, with its input, where the log is at rest.

    The parameters are of the hand with what it carries; compared are so many periods of a swing
    from there.
    """
    start = max(abs(float(log.angle[0]) - zero), _HANGING)
    period = Orbit.of_amplitude(replace(loaded, p3_offset=0.0, bias=0.0), start).period
    rows = log.time - log.time[0] <= periods * period
    cut = replace(log.take(rows), added_mass=NO_ADDED_MASS)
    return FreeRun.of(cut, Setting(parameters=loaded, zero=zero, velocity=0.0))
