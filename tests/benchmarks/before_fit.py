"""Count how often the forecast of `inspect` comes true, on data sets of known truth.

python -m tests.benchmarks.before_fit --robots 6 --seed 1
"""

import argparse
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

import butterfly as bf
from butterfly.identification.agreement import pace_of
from butterfly.identification.data import DataSet
from butterfly.identification.forecast import Identifiability, forecast
from butterfly.identification.trust import GOOD_WITHIN
from butterfly.model.prior import Prior
from butterfly.model.terms import PARAMETERS
from tests.benchmarks.kept import command, keep
from tests.independent import robots
from tests.independent.bodies import Encoder, Run, dry, hinge, record, with_gain
from tests.independent.drives import chirp, log_uniform, multisine, sine, steps
from tests.independent.kinds import driven
from tests.independent.robots import log_of


def _of_family(family, keep=lambda log, logs: True):  # noqa: ARG005 - all
    def draw(rng):
        robot = robots.draw(family, int(rng.integers(1000)), int(rng.integers(1000)))
        kept = [log for log in robot.logs if keep(log, robot.logs)]
        return DataSet.of(kept), vars(robot.truth)

    return draw


def _first_of_its_mass(log, logs):
    return log is next(each for each in logs if each.added_mass == log.added_mass)


def _heaviest(log, logs):
    return log.added_mass == max(each.added_mass for each in logs)


def _made(moved, *, masses=3, seconds=(20.0, 40.0), known=(), ticks=(1e-3, 5e-3), upright=False):
    def draw(rng):
        body, runs = moved(rng, hinge(rng, masses, upright=upright))
        body = with_gain(rng, body, [run.size for run in runs])
        encoder = Encoder.drawn(rng, rng.uniform(-0.5, 0.5))
        tick = float(log_uniform(rng, *ticks)), rng.uniform(0.0, 0.3)
        duration = rng.uniform(*seconds)
        seen = [record(rng, body, run, encoder, ticks=tick, duration=duration) for run in runs]
        logs = [log_of(each, f"log {k}") for k, each in enumerate(seen)]
        if upright:
            weightless = [replace(log.added_mass, gravity=0.0) for log in logs]
            pairs = zip(logs, weightless, strict=True)
            logs = [replace(log, added_mass=mass) for log, mass in pairs]
        truth = body.truth()
        told = Prior.of({name: truth[name] for name in known})
        return DataSet.of(logs, known=told), truth

    return draw


def _tiny(least, most):
    def moved(rng, body):
        aims = [
            (mass, body.pace_of(mass) * tone, float(log_uniform(rng, least, most)))
            for mass in body.masses
            for tone in (0.7, 1.5)
        ]
        body = dry(rng, body, [body.torque_of(*aim) for aim in aims])
        return body, [_sine(body, *aim) for aim in aims]

    return moved


def _one_frequency(rng, body):
    omega = body.pace_of(body.masses[1]) * rng.choice([0.7, 1.4])
    aims = [(m, omega, s) for m in body.masses for s in rng.uniform(0.1, 0.4, 2)]
    body = dry(rng, body, [body.torque_of(*aim) for aim in aims])
    return body, [_sine(body, *aim) for aim in aims]


def _sine(body, mass, omega, swing):
    size = body.torque_of(mass, omega, swing)
    return Run(mass=mass, torque=sine(size, omega), size=size, omega=omega)


def _one_way(rng, body):
    body = dry(rng, body, [body.torque_of(m, body.pace, 0.3) for m in body.masses])
    runs = []
    for m in body.masses:
        for _ in range(2):
            size = 1.5 * body.joint.coulomb + body.torque_of(m, body.pace, 0.3)
            changes, _ = steps(body.pace, 1.0, rng)
            push = lambda t, changes=changes, size=size: size * (1.0 + 0.3 * changes(t))  # noqa: E731
            runs.append(Run(mass=m, torque=push, size=1.3 * size))
    return body, runs


def _falls(rng, body):
    body = dry(rng, body, [body.torque_of(m, body.pace_of(m), 0.2) for m in body.masses])
    return body, [
        Run(mass=m, torque=np.zeros_like, size=body.joint.gravity, start=rng.uniform(0.3, 1.5))
        for m in body.masses
        for _ in range(2)
    ]


def _driven(inputs, each):
    return lambda rng, body: driven(rng, body, inputs, each)[:2]


SETS: dict[str, Callable] = {
    "full sines": _of_family("A"),
    "full, more friction": _of_family("B"),
    "full, other inputs": _of_family("C"),
    "one log of each mass": _of_family("C", _first_of_its_mass),
    "one sine of each mass": _of_family("A", _first_of_its_mass),
    "one mass, nothing known": _of_family("A", _heaviest),
    "one mass, gain known": _made(_driven([multisine, chirp], 3), masses=1, known=("p4",)),
    "one log, inertia known": _made(_driven([multisine], 1), masses=1, known=("p1",)),
    "tiny swings": _made(_tiny(0.003, 0.03)),
    "hardly any motion": _made(_tiny(3e-4, 3e-3)),
    "one frequency": _made(_one_frequency, seconds=(30.0, 40.0)),
    "no reversal": _made(_one_way, upright=True, seconds=(5.0, 10.0)),
    "free decays, nothing known": _made(_falls),
    "free decays, drive known": _made(_falls, known=("p4", "delay")),
    "short": _made(_driven([multisine, steps], 2), seconds=(0.3, 2.0)),
}
"""Makes a data set and the true values by name, from a generator of random numbers."""


class Row(NamedTuple):
    """One parameter of one data set: what was forecast, and how its identification ended.

    Relative half-width and error are infinite where it was refused; of a delay both are times the
    frequency of the fastest log.
    """

    name: str
    kind: str
    word: Identifiability
    width: float
    error: float

    @property
    def below(self) -> bool:
        """Whether it ended known within a tenth."""
        return self.width <= GOOD_WITHIN


def main(arguments=None):
    """Draw, forecast, identify, and print what came true."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, default=5, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", nargs="*", choices=SETS, default=list(SETS))
    asked = parser.parse_args(arguments)
    rows = []
    for kind in asked.kind:
        for number in range(asked.robots):
            rows += scored(kind, number, asked.seed)
            print(f"\r{kind} {number + 1}/{asked.robots}\033[K", end="", file=sys.stderr)
    print(file=sys.stderr)
    text = report(rows)
    print(text)
    keep("forecasts", text, command())


def scored(kind, number, seed):
    """Forecast and identify a data set that these numbers alone determine."""
    rng = np.random.default_rng([seed, list(SETS).index(kind), number])
    try:
        data, truth = SETS[kind](rng)
    except bf.ButterflyError as error:  # a joint that friction holds is none to forecast
        print(f"{kind} {number}: {error}", file=sys.stderr)
        return []
    forecasts = forecast(data.recorded, data.given)
    try:
        found = bf.identify(data).estimate
    except bf.ButterflyError:
        found = None
    fastest = max(map(pace_of, data.logs))
    rows = []
    for each in forecasts:
        width = error = math.inf
        if each.word is Identifiability.KNOWN:
            continue
        if found is not None and each.name in found.names:
            value = found.named[each.name]
            width, size = found.relative_half_widths[each.name], abs(truth[each.name])
            if each.name == "delay":
                size = 1 / fastest
                width = float(found.farther[found.names.index("delay")]) / size
            error = abs(value - truth[each.name]) / size if size else math.inf
        rows.append(Row(each.name, f"{kind} {number}", each.word, width, error))
    return rows


def report(rows):
    """Return the table of confusion as text, and what was forecast wrong."""
    words = (Identifiability.IDENTIFIABLE, Identifiability.WEAK, Identifiability.NOT)
    heads = [f"{word}, ends {end}" for word in words for end in ("below 10 %", "above")]
    lines = [f"| {len({each.kind for each in rows})} data sets | {' | '.join(heads)} |"]
    lines.append("|---" * (len(heads) + 1) + "|")
    for name in (*PARAMETERS, "all"):
        own = [each for each in rows if name in {each.name, "all"}]
        cells = [
            [each for each in own if each.word is word and each.below is below]
            for word in words
            for below in (True, False)
        ]
        off = [sum(each.error > GOOD_WITHIN for each in cell) for cell in cells]
        told = (f"{len(cell)} ({wrong})" for cell, wrong in zip(cells, off, strict=True))
        lines.append(f"| {name} | {' | '.join(told)} |")
    lines.append("In brackets: how many of them are off the truth by more than 10 %, or refused.")
    lines += [
        f"  {each.kind}: {each.name} {each.word}, ends ± {100 * each.width:.3g} %, "
        f"off by {100 * each.error:.2g} %"
        for each in rows
        if each.word is (Identifiability.NOT if each.below else Identifiability.IDENTIFIABLE)
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
