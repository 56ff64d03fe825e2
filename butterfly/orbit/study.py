"""How much better the re-calibrated model is next to the orbit, and how far from it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.diagnostics.goodness_of_fit import judge_fit
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FreeRun, Setting
from butterfly.logs.log import Log
from butterfly.model.energy import Orbit
from butterfly.model.parameters import NO_ADDED_MASS, LumpedParameters
from butterfly.orbit.controller import Dithered
from butterfly.orbit.loop import Calibration, Plan, RunLaw, calibrate
from butterfly.orbit.recalibration import recalibrate
from butterfly.orbit.recalibration_options import RecalibrationOptions
from butterfly.progress import Track, untracked

PERIODS = 5
"""Length of the free runs that are compared, in periods of the orbit."""

_BESIDE = 1.08  # amplitude over the orbit's, at which a held-out run starts
_DITHER = 0.2  # of a held-out run
_HANGING = 1e-3  # rad, of a swing as long as that of a hand that begins where it hangs
_AROUND = (1.0, 0.8, 1.2)  # amplitudes over the orbit's, at which runs for its calibration start


@dataclass(frozen=True, kw_only=True, eq=False)
class OrbitStudy:
    """A calibration, and how well its model predicts runs that it has not seen.

    Parameters
    ----------
    name, description
        Of the experiment.
    zero
        Encoder reading in rad of the hanging hand.
    generic
        Parameters of the loaded hand that the loop began with.
    calibration
        The loop.
    held_out
        A run next to the orbit that was used for nothing else.
    estimate
        Of the last round, judged by how well its free run follows that run.
    small_swings
        What it began with was identified so; None if the parameters were told.
    errors
        By model ("generic", "re-calibrated"): rms error in rad of its free run over `PERIODS`.
    amplitudes
        (n,) amplitudes in rad of the orbits of the next.
    cross
        (n, n) rms error in rad of models re-calibrated at the orbit of the row, at that of the
        column.
    """

    name: str
    description: str
    zero: float
    generic: LumpedParameters
    calibration: Calibration
    held_out: Log
    estimate: Estimate
    small_swings: Estimate | None
    errors: dict[str, float]
    amplitudes: tuple[float, ...]
    cross: NDArray[np.float64]


def study_orbit(
    rig: RunLaw,
    believed: LumpedParameters,
    zero: float,
    plan: Plan,
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

    Parameters
    ----------
    rig, believed, zero, plan, options
        As `butterfly.orbit.loop.calibrate` takes them.
    amplitudes
        Of the orbits in rad at which models are re-calibrated and used crosswise.
    small_swings
        What ``believed`` is from, if it was identified.
    rng
        Source of the dither.
    name, description
        For the report.
    track
        Shows progress.
    """
    calibration = calibrate(rig, believed, zero, plan, options, rng=rng, track=track)
    carried = plan.added_masses[0]
    final = calibration.parameters

    def run(amplitude: float, start: float, dither: float) -> Log:
        orbit = Orbit.of_amplitude(final, amplitude)
        law = Dithered(plan.law(orbit, zero), dither, 2 * np.pi / orbit.period, rng)
        return rig(law, start, plan.duration, carried)

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
    """Return a free run from the log's first sample, with its input.

    Parameters
    ----------
    log
        That starts at rest.
    loaded
        Parameters of the hand with what it carries.
    zero
        Encoder reading in rad of the hanging hand.
    periods
        How many of the swing from the first sample to compare.
    """
    start = max(abs(float(log.angle[0]) - zero), _HANGING)
    period = Orbit.of_amplitude(replace(loaded, p3_offset=0.0, bias=0.0), start).period
    rows = log.time - log.time[0] <= periods * period
    cut = replace(log.take(rows), added_mass=NO_ADDED_MASS)
    return FreeRun.of(cut, Setting(parameters=loaded, zero=zero, velocity=0.0))
