"""The thesis's tables, published and reproduced, and their synthetic robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import InputError
from butterfly.files import shipped
from butterfly.identification.data import read_data_set
from butterfly.identification.estimators import HarmonicBalance
from butterfly.logs.log import InputKind, Intersample, Log, Sine
from butterfly.logs.manifest import read_manifest
from butterfly.logs.thesis_logs import found_folder
from butterfly.model.control_bridge import transfer_function
from butterfly.model.greybox import simulate
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import AddedMass
from butterfly.plant.rig import Rig
from butterfly.signals.frequency_response import ResponsePoint, response_point
from butterfly.thesis.claims import digits
from butterfly.thesis.method import (
    ScriptedAmplitude,
    fit_resonances,
    fit_thesis,
    scripted_resonance,
)

COARSE = 4
"""Keep every n-th sample of the synthetic data, as the scripts do: 0.04 s."""

WINDOW = 45.0
"""Length in s of the end of a record that the first script uses."""

TABLE_1_PRINTED = ("3.8788 4.0671 4.4156 4.8812 5.4194", "3.7740 3.7705 4.0492 4.4680 5.0265")
TABLE_4_PRINTED = "4.1915 5.7650 6.2847"
_START = 0.01  # rad, at which the Simulink model starts
_ITERATIONS = 30  # of the complex fit
_TABLE_2_PRINTED = ("0.0033 0.0453", "0.0033 0.0100 0.0606")


@dataclass(frozen=True, kw_only=True)
class Synthetic:
    """Data of Tables 1 and 2 and Figures 3 to 8: each sine with each added mass."""

    rig: Rig  # the robot, its clock and its encoder
    added_masses: Sequence[AddedMass]
    sines: Sequence[Sine]
    duration: float  # of a run in s


def synthetic_log(synthetic: Synthetic, added: AddedMass, sine: Sine, *, noise: bool) -> Log:
    """Simulate one response of the thesis's synthetic robot to a continuous sine, like Simulink."""
    clock = synthetic.rig.clock
    step = clock.step
    time = step * np.arange(clock.count(synthetic.duration) + 1, dtype=np.float64)
    instants = np.column_stack([time[:-1], time[:-1] + step / 2, time[1:]])
    loaded = synthetic.rig.robot.lumped.with_added_mass(added)
    angle, _ = simulate(loaded, time, sine.sample(instants), _START)
    source = synthetic.rig.encoder.band_limited
    if noise and source is not None:
        angle = angle + source.sample(time)
    return Log(
        time=time,
        input=sine.sample(time),
        angle=angle,
        input_kind=InputKind.TORQUE,
        intersample=Intersample.FIRST_ORDER_HOLD,
        added_mass=added,
        excitation=sine,
        source="synthetic",
    )


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line of the comparison."""

    what: str  # which figures
    published: str
    obtained: str  # computed here in the thesis's way
    corrected: str = ""  # what is right, where the thesis is not
    note: str = ""  # why

    @property
    def agrees(self) -> bool:
        """Whether every published digit was reproduced."""
        return self.published == self.obtained


def reproduce(synthetic: Synthetic, root: Path | None = None) -> list[Row]:
    """Compute Tables 1, 2, 4 and 5 and (63), (66) as in the thesis, and corrected.

    Tables 4 and 5 need the 41 real logs (see `has_real_logs`).
    """
    scripted, right = _table_1(synthetic)
    return [
        *_linearisation(synthetic),
        *_table_1_rows(synthetic, scripted, right),
        *_table_2_rows(scripted, right),
        *(_real_rows(root) if has_real_logs(root) else []),
    ]


def has_real_logs(root: Path | None) -> bool:
    """Whether the real logs are in `root`, BUTTERFLY_LOGS or the folder of `fetch`."""
    return root is not None or found_folder() is not None


def scripted_point(log: Log) -> ScriptedAmplitude:
    """Dominant DFT bin and gain in dB, as in the thesis's first script."""
    assert log.excitation is not None  # noqa: S101 - synthetic logs are sines
    step = log.mean_step
    coarse = log.angle[::COARSE][-math.floor(WINDOW / (COARSE * step)) - 1 :]
    fine = log.angle[-math.floor(WINDOW / step) - 1 :] - (coarse.max() + coarse.min()) / 2
    power = np.abs(np.fft.fft(coarse)[1 : coarse.size // 2]) ** 2
    amplitude = math.sqrt(2 * step / WINDOW * float(np.sum(fine**2)))
    return ScriptedAmplitude(
        omega=2 * math.pi * (int(np.argmax(power)) + 1) / ((coarse.size - 1) * COARSE * step),
        gain_db=20 * math.log10(amplitude / log.excitation.amplitude),
    )


def _scripted_resonance(points: Sequence[ScriptedAmplitude]) -> float:
    """(100) with the first script's mistake: an index into the array without its maximum."""
    gains = [point.gain_db for point in points]
    first = int(np.argmax(gains))
    return scripted_resonance(points[first], points[int(np.argmax(np.delete(gains, first)))])


def complex_fit(points: Sequence[ResponsePoint]) -> tuple[Samples, Samples]:
    """Return (3,) a1, a0, b0 of b0/(-w^2 + j a1 w + a0), and their (3, 3) covariance.

    Maximum likelihood of complex responses of one robot: Sanathanan and Koerner's iteration,
    weighted by the measured errors. Each row is divided by the previous denominator, so response
    errors are minimised, whose Gaussian likelihood is then largest.
    """
    if len({point.added_mass for point in points}) > 1:
        raise InputError("resonance", "added mass", "several", "one")
    omega = np.array([point.omega for point in points])
    response = np.array([point.gain for point in points])
    error = np.array([point.angle.amplitude_error / abs(point.input) for point in points])
    error = np.maximum(error, 1e-15 * np.abs(response))
    weight = 1 / (error * omega**2)
    for _ in range(_ITERATIONS):
        matrix = np.column_stack([1j * omega * response, response, -np.ones(omega.size)])
        rows = matrix * weight[:, None]
        target = omega**2 * response * weight
        rows = np.concatenate([rows.real, rows.imag])
        target = np.concatenate([target.real, target.imag])
        scale = np.linalg.norm(rows, axis=0)
        values = np.linalg.lstsq(rows / scale, target, rcond=None)[0] / scale
        denominator = values[1] - omega**2 + 1j * omega * values[0]
        weight = 1 / (error * np.abs(denominator))
    normal = np.linalg.inv((rows / scale).T @ (rows / scale)) / np.outer(scale, scale)
    return values, normal


def _table_1(synthetic: Synthetic) -> tuple[dict[AddedMass, float], dict[AddedMass, float]]:
    """Return the resonances by the script's (100), and by the complex fit of the same data."""
    scripted, right = {}, {}
    for added in synthetic.added_masses:
        logs = [synthetic_log(synthetic, added, sine, noise=True) for sine in synthetic.sines]
        scripted[added] = _scripted_resonance([scripted_point(log) for log in logs])
        (a1, a0, _), _ = complex_fit([response_point(log) for log in logs])
        right[added] = math.sqrt(a0 - a1**2 / 2)  # (73)
    return scripted, right


def _linearisation(synthetic: Synthetic) -> list[Row]:
    p = synthetic.rig.robot.lumped
    discrete = transfer_function(p).sample(COARSE * synthetic.rig.clock.step, "zoh")
    (_, a1, a0), (b1, b0) = discrete.den[0][0], discrete.num[0][0]
    return [
        Row(
            what="(63) a1 a0 b0",
            published="0.308 15.09 3076.9",
            obtained=f"{p.p2 / p.p1:.3f} {p.p3 / p.p1:.2f} {p.p4 / p.p1:.1f}",
        ),
        Row(
            what="(66) a1 a0 b1 b0",
            published="-1.9638 0.9878 2.4465 2.4365",
            obtained=digits([a1, a0, b1, b0]),
        ),
    ]


def _table_1_rows(
    synthetic: Synthetic, scripted: dict[AddedMass, float], right: dict[AddedMass, float]
) -> list[Row]:
    p = synthetic.rig.robot.lumped
    nearest = synthetic.added_masses[1].arm
    twice = [
        resonance_frequency(p.with_added_mass(m).with_added_mass(replace(m, arm=nearest)))
        for m in synthetic.added_masses
    ]
    once = [resonance_frequency(p.with_added_mass(m)) for m in synthetic.added_masses]
    return [
        Row(
            what="Table 1, column 3: (79)",
            published=TABLE_1_PRINTED[0],
            obtained=digits(twice),
            corrected=digits(once),
            note="the thesis counts each added mass twice, once at the shortest arm",
        ),
        Row(
            what="Table 1, column 4: (100)",
            published=TABLE_1_PRINTED[1],
            obtained=digits(scripted.values()),
            corrected=digits(right.values()),
            note="mistakes: sign, gains in dB, index; corrected: complex fit of the same data",
        ),
    ]


def _table_2_rows(scripted: dict[AddedMass, float], right: dict[AddedMass, float]) -> list[Row]:
    rows = []
    bounds = ((1.0, 1.0, 1.0), (0.0325, 0.01, 0.4905))
    for printed, upper, p2 in zip(_TABLE_2_PRINTED, bounds, (0.001, None), strict=True):
        found, better = (fit_resonances(values, upper, p2=p2)[0] for values in (scripted, right))
        kept = [0, 2] if p2 else [0, 1, 2]
        rows.append(
            Row(
                what=f"Table 2, {'p1 p3' if p2 else 'p1 p2 p3'}: (102)",
                published=printed,
                obtained=digits(found[kept]),
                corrected=digits(better[kept]),
                note="true: 0.0033 0.0010 0.0491; corrected: from the complex fit's resonances",
            )
        )
    return rows


def _real_rows(root: Path | None) -> list[Row]:
    data = read_data_set(read_manifest(shipped("experiments/real-logs.yaml"), root))
    fine, coarse = fit_thesis(data.recorded, 5), fit_thesis(data.recorded, 25)
    right = HarmonicBalance()(data).parameters
    resonances = [resonance_frequency(right.with_added_mass(mass)) for mass in data.masses]
    return [
        Row(
            what="Table 4: (100)",
            published=TABLE_4_PRINTED,
            obtained=digits(coarse.resonances.values()),
            corrected=digits(resonances),
            note="corrected: linearisation by harmonic balance of the same logs",
        ),
        Row(
            what="Table 5, p1 p2 p3: (102)",
            published="0.0028 0.0188 0.0583",
            obtained=digits(fine.values[:3]),
            corrected=digits([right.p1, right.p2, right.p3]),
            note="published: where the optimiser stopped; reproduced: the minimum, from step-5 "
            "data; corrected: harmonic balance",
        ),
    ]
