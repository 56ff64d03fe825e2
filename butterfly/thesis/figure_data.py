"""The data of the thesis's Figures 3 to 12, as CSV files."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import zip_longest
from pathlib import Path

import numpy as np

from butterfly.arrays import Samples
from butterfly.files import replacing, shipped
from butterfly.logs.log import Log
from butterfly.logs.manifest import read_manifest
from butterfly.logs.reading import read_entry
from butterfly.model.control_bridge import transfer_function
from butterfly.model.linear import Linearisation
from butterfly.model.parameters import NO_ADDED_MASS
from butterfly.signals.spectrum import periodogram, resample, uniform_grid
from butterfly.thesis.method import scripted_amplitude
from butterfly.thesis.tables import COARSE, Synthetic, has_real_logs, scripted_point, synthetic_log

Columns = dict[str, Samples]

_WINDOW = 40.0  # s of Figure 6
_REAL_STEP = 0.04  # s, to which Figures 9 and 11 are resampled
_REAL_MASS, _REAL_OMEGA = 0.154, 14.0  # of Figures 9 to 11


def write_figure_data(folder: Path, synthetic: Synthetic, root: Path | None = None) -> list[Path]:
    """Write ``figure_03.csv`` to ``figure_12.csv``, units in the headers, and return the files.

    Figures 9 to 12 need the 41 real logs in `root`, BUTTERFLY_LOGS or the folder of `fetch`;
    otherwise they are skipped.
    """
    figures = _synthetic(synthetic)
    if has_real_logs(root):
        figures |= _real(root)
    paths = []
    for number, columns in sorted(figures.items()):
        path = folder / f"figure_{number:02d}.csv"
        with replacing(path) as draft:
            rows = list(zip_longest(*columns.values(), fillvalue=math.nan))
            header = ",".join(columns)
            np.savetxt(draft, rows, fmt="%.9g", delimiter=",", header=header, comments="")
        paths.append(path)
    return paths


def _synthetic(synthetic: Synthetic) -> dict[int, Columns]:
    sines = {sine.omega: sine for sine in synthetic.sines}
    clean = {
        omega: synthetic_log(synthetic, NO_ADDED_MASS, sine, noise=False)
        for omega, sine in sines.items()
    }
    noisy = [synthetic_log(synthetic, NO_ADDED_MASS, s, noise=True) for s in sines.values()]
    slow = clean[4.0]
    coarse = COARSE * slow.mean_step
    frequency, power = periodogram(slow.angle[::COARSE][-math.floor(_WINDOW / coarse) :], coarse)
    omega = np.array(list(sines))
    linear = synthetic.rig.robot.lumped
    curve = np.linspace(0.5, 8.0, 400)
    held = transfer_function(linear).sample(coarse, "zoh")

    def gains(logs: Iterable[Log]) -> Samples:
        return np.array([10 ** (scripted_point(log).gain_db / 20) for log in logs])

    motion = {"time_s": slow.time, "angle_rad": slow.angle}
    quiet = {"gain_without_noise": gains(clean.values())}
    return {
        3: motion,
        4: {"time_s": clean[7.0].time, "angle_rad": clean[7.0].angle},
        5: motion
        | {"coarse_time_s": slow.time[::COARSE], "coarse_angle_rad": slow.angle[::COARSE]},
        6: {"omega_rad_per_s": frequency, "power_rad2": power},
        7: {"omega_rad_per_s": omega, **quiet, "gain_with_noise": gains(noisy)},
        8: {
            "curve_omega_rad_per_s": curve,
            "linearisation_gain": np.abs(Linearisation.of(linear).response(curve)),
            "held_linearisation_gain": np.abs(held(np.exp(1j * curve * coarse))),
            "omega_rad_per_s": omega,
            **quiet,
        },
    }


def _real(root: Path | None) -> dict[int, Columns]:
    manifest = read_manifest(shipped("experiments/real-logs.yaml"), root)
    logs = [read_entry(manifest, entry) for entry in manifest.logs]
    shown = next(
        log
        for log in logs
        if log.excitation
        and (log.added_mass.mass, log.excitation.omega) == (_REAL_MASS, _REAL_OMEGA)
    )
    grid = uniform_grid(shown.time, _REAL_STEP)
    coarse = resample(shown.time, shown.angle, grid)
    steady = coarse[-round(30 / _REAL_STEP) :]
    frequency, power = periodogram(steady - steady.mean(), _REAL_STEP)
    gains: Columns = {}
    for mass in sorted({log.added_mass for log in logs}):
        own = [log for log in logs if log.added_mass == mass]
        points = [scripted_amplitude(log) for log in own]
        name = f"{1e3 * mass.mass:g}g"
        gains[f"omega_{name}_rad_per_s"] = np.array(
            [log.excitation.omega for log in own if log.excitation]
        )
        gains[f"gain_{name}_dB"] = np.array([point.gain_db for point in points])
    return {
        9: {
            "time_s": shown.time,
            "angle_rad": shown.angle,
            "coarse_time_s": grid,
            "coarse_angle_rad": coarse,
        },
        10: {"time_s": shown.time[1:], "interval_s": np.diff(shown.time)},
        11: {"omega_rad_per_s": frequency, "power_rad2": power},
        12: gains,
    }
