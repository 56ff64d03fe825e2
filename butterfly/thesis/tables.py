"""The thesis's tables, published and reproduced, their synthetic robot, and claims on figures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np

from butterfly.arrays import Samples
from butterfly.files import shipped, write_file
from butterfly.identification.data import read_data_set
from butterfly.identification.estimators import HarmonicBalance, Linear
from butterfly.logs.log import InputKind, Intersample, Log, Sine
from butterfly.logs.manifest import read_manifest
from butterfly.logs.thesis_logs import found_folder
from butterfly.model.control_bridge import transfer_function
from butterfly.model.greybox import simulate
from butterfly.model.linear import resonance_frequency
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from butterfly.model.prior import Prior
from butterfly.plant.rig import Rig
from butterfly.signals.frequency_response import ResponsePoint, response_point
from butterfly.thesis.method import by_100, fit_resonances, fit_thesis, scripted_gain

CLOSE = 0.01
"""Relative difference up to which two numbers agree."""


class Claim(NamedTuple):
    """A statement on a figure, with the number obtained here, and whether they agree."""

    text: str
    holds: bool


def near(what: str, expected: float, seen: float, unit: str = "", within: float = 0.0) -> Claim:
    """Compare a number with the expected one: they agree ``within`` a bound, or up to 1 %."""
    holds = abs(seen - expected) <= max(within, CLOSE * abs(expected))
    return Claim(f"{what} {expected:.4g}{unit} (here {seen:.4g}{unit})", bool(holds))


@dataclass(frozen=True, eq=False)
class ThesisFigure:
    """Curves by their names in the legend, how they are drawn, and claims on them."""

    name: str  # of its files
    title: str
    axes: tuple[str, str]
    # a look (line, dots, circles or crosses), and two columns of (n,) values by name and unit
    curves: Mapping[str, tuple[str, Mapping[str, Samples]]]
    claims: Sequence[Claim]
    marks: Mapping[str, float] = field(default_factory=dict)  # abscissae that are printed
    logarithmic: str = ""  # axes, of "xy"
    shown: tuple[float, float] | None = None  # part of the first axis that is drawn
    about: str = ""  # what it shows

    @property
    def sentence(self) -> str:
        """What agrees and what does not."""
        parts = []
        for how, holds in (("Agrees", True), ("Does not agree", False)):
            some = "; ".join(claim.text for claim in self.claims if claim.holds == holds)
            parts += [f"{how}: {some}."] if some else []
        return " ".join(parts)

    @property
    def columns(self) -> dict[str, Samples]:
        """All columns by name."""
        return {k: v for _, columns in self.curves.values() for k, v in columns.items()}

    def write(self, folder: Path) -> None:
        """Write all columns as ``folder``/NAME.csv."""
        columns = self.columns
        texts = ([x if isinstance(x, str) else f"{x:.9g}" for x in v] for v in columns.values())
        rows = [[*columns], *zip_longest(*texts, fillvalue="nan"), [""]]
        write_file(folder / f"{self.name}.csv", "\n".join(map(",".join, rows)))


def digits(values: Iterable[float]) -> str:
    """Return numbers as the thesis prints them."""
    return " ".join(f"{value:.4f}" for value in values)


COARSE = 4
"""Keep every n-th sample of the synthetic data, as the scripts do: 0.04 s."""

TABLE_1_PRINTED = ("3.8788 4.0671 4.4156 4.8812 5.4194", "3.7740 3.7705 4.0492 4.4680 5.0265")
TABLE_4_PRINTED = "4.1915 5.7650 6.2847"
_WINDOW = 45.0  # s at the end of a record that the first script uses
_START = 0.01  # rad, at which the Simulink model starts
_TABLE_2 = (  # title, printed values, upper bounds, given p2
    ("Table 2, p1 p3", "0.0033 0.0453", (1.0, 1.0, 1.0), 0.001),
    ("Table 2, p1 p2 p3", "0.0033 0.0100 0.0606", (0.0325, 0.01, 0.4905), None),
)


@dataclass(frozen=True)
class Synthetic:
    """Data of Tables 1 and 2 and Figures 3 to 8: each sine with each added mass."""

    rig: Rig  # the robot, its clock and its encoder
    added_masses: Sequence[AddedMass]
    sines: Sequence[Sine]
    duration: float  # of a run in s


def synthetic_log(synthetic: Synthetic, added: AddedMass, sine: Sine, *, noise: bool) -> Log:
    """Simulate one response of the thesis's synthetic robot to a continuous sine, like Simulink."""
    clock = synthetic.rig.clock
    time = clock.step * np.arange(clock.count(synthetic.duration) + 1, dtype=np.float64)
    instants = np.column_stack([time[:-1], time[:-1] + clock.step / 2, time[1:]])
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


HEADERS = ("", "", "values", "same")
"""Of the columns of `compared`."""


class Row(NamedTuple):
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


def has_real_logs(root: Path | None) -> bool:
    """Whether the real logs are in `root`, BUTTERFLY_LOGS or the folder of `fetch`."""
    return root is not None or found_folder() is not None


def scripted_point(log: Log) -> tuple[float, float]:
    """Dominant DFT bin and gain in dB, as in the thesis's first script."""
    assert log.excitation is not None  # noqa: S101 - synthetic logs are sines
    step = log.mean_step
    coarse = log.angle[::COARSE][-math.floor(_WINDOW / (COARSE * step)) - 1 :]
    fine = log.angle[-math.floor(_WINDOW / step) - 1 :]
    return scripted_gain(coarse, COARSE * step, fine, _WINDOW / step, log.excitation.amplitude)


def scripted_resonance(points: Sequence[tuple[float, float]]) -> float:
    """(100) with the first script's mistake: an index into the array without its maximum."""
    omega, gain = np.transpose(points)
    first = gain.argmax()
    two = [first, np.delete(gain, first).argmax()]
    return by_100(omega[two], gain[two])


def complex_resonance(points: Sequence[ResponsePoint]) -> float:
    """Return the resonance (73) in rad/s from complex responses; p1 = 1 is as good as any."""
    bare = [replace(point, added_mass=NO_ADDED_MASS) for point in points]
    return resonance_frequency(Linear().of_points(bare, Prior.of({"p1": 1.0})).parameters)


def reproduce(synthetic: Synthetic, root: Path | None = None) -> list[Row]:
    """Compute Tables 1, 2, 4 and 5 and (63), (66) as in the thesis, and corrected.

    Tables 4 and 5 need the 41 real logs (see `has_real_logs`).
    """
    p, masses, scripted, right = synthetic.rig.robot.lumped, synthetic.added_masses, {}, {}
    discrete = transfer_function(p).sample(COARSE * synthetic.rig.clock.step, "zoh")
    (_, a1, a0), (b1, b0) = discrete.den[0][0], discrete.num[0][0]
    continuous = f"{p.p2 / p.p1:.3f} {p.p3 / p.p1:.2f} {p.p4 / p.p1:.1f}"
    once = [p.with_added_mass(m) for m in masses]
    again = [replace(m, arm=masses[1].arm) for m in masses]
    twice = [robot.with_added_mass(m) for robot, m in zip(once, again, strict=True)]
    exact, doubled = (digits(map(resonance_frequency, robots)) for robots in (once, twice))
    for mass in masses:
        logs = [synthetic_log(synthetic, mass, sine, noise=True) for sine in synthetic.sines]
        scripted[mass] = scripted_resonance([scripted_point(log) for log in logs])
        right[mass] = complex_resonance([response_point(log) for log in logs])
    obtained, better = digits(scripted.values()), digits(right.values())
    wrong = "the thesis counts each added mass twice, once at the shortest arm"
    mistakes = "mistakes: sign, gains in dB, index; corrected: complex fit of the same data"
    rows = [
        Row("(63) a1 a0 b0", "0.308 15.09 3076.9", continuous),
        Row("(66) a1 a0 b1 b0", "-1.9638 0.9878 2.4465 2.4365", digits([a1, a0, b1, b0])),
        Row("Table 1, column 3: (79)", TABLE_1_PRINTED[0], doubled, exact, wrong),
        Row("Table 1, column 4: (100)", TABLE_1_PRINTED[1], obtained, better, mistakes),
    ]
    truth = "true: 0.0033 0.0010 0.0491; corrected: from the complex fit's resonances"
    for what, printed, upper, p2 in _TABLE_2:
        fits = (fit_resonances(resonances, upper, p2=p2)[0] for resonances in (scripted, right))
        obtained, better = (digits(fit[:: 1 if p2 is None else 2]) for fit in fits)
        rows.append(Row(f"{what}: (102)", printed, obtained, better, truth))
    return rows + (_real_rows(root) if has_real_logs(root) else [])


def _real_rows(root: Path | None) -> list[Row]:
    data = read_data_set(read_manifest(shipped("experiments/real-logs.yaml"), root))
    fine, coarse = fit_thesis(data.recorded, 5), fit_thesis(data.recorded, 25)
    p = HarmonicBalance()(data).parameters
    obtained = digits(coarse.resonances.values())
    right = digits(resonance_frequency(p.with_added_mass(mass)) for mass in data.masses)
    how = "corrected: linearisation by harmonic balance of the same logs"
    stopped = (
        "published: where the optimiser stopped; reproduced: the minimum, from step-5 data; "
        "corrected: harmonic balance"
    )
    values = digits(fine.values[:3]), digits([p.p1, p.p2, p.p3])
    return [
        Row("Table 4: (100)", TABLE_4_PRINTED, obtained, right, how),
        Row("Table 5, p1 p2 p3: (102)", "0.0028 0.0188 0.0583", *values, stopped),
    ]


def compared(rows: Sequence[Row]) -> list[tuple[str, str, str, str]]:
    """Return published, reproduced and, where they differ, corrected values below each other."""
    lines = []
    for row in rows:
        lines.append((row.what, "published", row.published, ""))
        lines.append(("", "reproduced", row.obtained, "yes" if row.agrees else "no"))
        if row.corrected:
            lines.append(("", "corrected", row.corrected, ""))
    return lines
