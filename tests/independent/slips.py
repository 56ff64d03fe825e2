"""Data sets of random robots with the slips that people make, and what is said of them.

`python -m tests.independent.slips --robots 5` prints how many of each are recognised and named, and
what is said of sets without a slip (none).
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from butterfly.errors import ButterflyError
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, WeakForm
from butterfly.identification.identify import identify
from butterfly.identification.trust import FindingKind
from butterfly.logs.log import Log
from butterfly.logs.reading import with_unique_names
from butterfly.model.parameters import AddedMass
from butterfly.report.finding_texts import estimate_sentences
from butterfly.verdict import Level
from tests.benchmarks.coverage import options, write
from tests.independent.robots import FAMILIES
from tests.independent.robots import draw as draw_robot

Logs = list[Log]


def every(change: Callable[[Log], Log]) -> Callable[[Logs, np.random.Generator], Logs]:
    """Make a slip of a whole data set of what it does to a log."""
    return lambda logs, _: [change(log) for log in logs]


def _in_rpm(log: Log) -> Log:
    assert log.excitation is not None
    sine = replace(log.excitation, omega=log.excitation.omega * 60 / (2 * np.pi))
    return replace(log, excitation=sine)


def _counts(logs: Logs, draw: np.random.Generator) -> Logs:
    turn = int(draw.choice([1000, 2000, 4096, 8192]))
    return [replace(log, angle=np.round(log.angle * turn / (2 * np.pi))) for log in logs]


def _heavier(log: Log, factor: float, arm: float = 1.0) -> Log:
    mass = log.added_mass
    return replace(log, added_mass=AddedMass(mass=mass.mass * factor, arm=mass.arm * arm))


def _one_mass(logs: Logs, draw: np.random.Generator) -> Logs:
    wrong = draw.choice(sorted({log.added_mass for log in logs if log.added_mass.mass}))
    factor = float(draw.choice([0.1, 0.5, 0.8, 1.25, 2.0, 10.0]))
    return [_heavier(log, factor) if log.added_mass == wrong else log for log in logs]


def _one_log(logs: Logs, draw: np.random.Generator) -> Logs:
    masses = sorted({log.added_mass for log in logs})
    chosen = int(draw.integers(len(logs)))
    others = [mass for mass in masses if mass != logs[chosen].added_mass]
    wrong = others[int(draw.integers(len(others)))]
    return [replace(log, added_mass=wrong) if k == chosen else log for k, log in enumerate(logs)]


def _one_omega(logs: Logs, draw: np.random.Generator) -> Logs:
    chosen = int(draw.integers(len(logs)))
    factor = float(draw.choice([0.5, 0.9, 0.98, 1.02, 1.1, 2.0]))
    changed = list(logs)
    sine = logs[chosen].excitation
    assert sine is not None
    changed[chosen] = replace(logs[chosen], excitation=replace(sine, omega=sine.omega * factor))
    return changed


def _one_late(logs: Logs, draw: np.random.Generator) -> Logs:
    chosen = int(draw.integers(len(logs)))
    log = logs[chosen]
    late = replace(log, input=np.interp(log.time - 0.05, log.time, log.input))
    return [late if k == chosen else log for k, log in enumerate(logs)]


@dataclass(frozen=True)
class Case:
    """A slip: what it does to logs, and the words that name it."""

    make: Callable[[Logs, np.random.Generator], Logs]
    words: tuple[str, ...]


CASES = {
    "degrees": Case(every(lambda log: replace(log, angle=np.degrees(log.angle))), ("degrees",)),
    "turns": Case(every(lambda log: replace(log, angle=log.angle / (2 * np.pi))), ("turns",)),
    "ms": Case(every(lambda log: replace(log, time=log.time * 1e3)), ("millisec",)),
    "us": Case(every(lambda log: replace(log, time=log.time * 1e6)), ("microsec",)),
    "swapped": Case(
        every(lambda log: replace(log, input=log.angle, angle=log.input)), ("swapped",)
    ),
    "rpm": Case(every(_in_rpm), ("revolutions per minute",)),
    "counts": Case(_counts, ("counts",)),
    "arm in mm": Case(every(lambda log: _heavier(log, 1.0, 1e3)), ("millimetres",)),
    "arm in cm": Case(every(lambda log: _heavier(log, 1.0, 1e2)), ("centimetres",)),
    "diameter": Case(every(lambda log: _heavier(log, 1.0, 2.0)), ("diameters",)),
    "late": Case(_one_late, ("late",)),
    "one mass": Case(_one_mass, ()),
    "mass of a log": Case(_one_log, ()),
    "omega": Case(_one_omega, ()),
    "sign of angle": Case(every(lambda log: replace(log, angle=-log.angle)), ("angle", "input")),
    "sign of input": Case(every(lambda log: replace(log, input=-log.input)), ("angle", "input")),
    "grams": Case(every(lambda log: _heavier(log, 1e3)), ("grams",)),
}
OF_SINES = {"rpm", "omega"}
NAMED = {
    *(FindingKind.UNIT_ERROR, FindingKind.SUSPECTED, FindingKind.ASKED),
    FindingKind.NEGATIVE_GAIN,
}


@dataclass(frozen=True)
class Answer:
    """What was said of a data set."""

    recognised: bool
    text: str
    standing: str = "refused"
    slip: str = "none"
    named: bool = False


def ask(logs: Logs, family: str) -> Answer:
    """Identify as a user would, and tell what is said first."""
    estimator = WeakForm() if family == "C" else HarmonicBalance()
    try:
        found = identify(DataSet.of(logs), estimator).estimate
    except ButterflyError as error:
        return Answer(recognised=True, text=str(error))
    slips = any(each.kind in NAMED for each in found.findings)
    text = " ".join(estimate_sentences(found))
    recognised = slips or found.level is not Level.GOOD
    return Answer(recognised=recognised, text=text, standing=found.level.verdict)


def names_it(name: str, logs: Logs, slipped: Logs, text: str) -> bool:
    """Tell whether a text names the slip that was made."""
    pairs = zip(logs, slipped, strict=True)
    differ = [
        k
        for k, (a, b) in enumerate(pairs)
        if (a.added_mass, a.excitation) != (b.added_mass, b.excitation) or a.input is not b.input
    ]
    if name == "one mass":
        return f"if {slipped[differ[0]].added_mass} is really" in text
    if before := {"mass of a log": "in", "omega": "for", "late": "In"}.get(name):
        return f"{before} {with_unique_names(slipped)[differ[0]].name}" in text
    return all(word in text for word in CASES[name].words)


def main(arguments: list[str] | None = None) -> None:
    """Ask about random robots with each slip, and print a line of each."""
    parser = options(__doc__, ("none", *CASES), 5)
    parser.add_argument("--family", choices=FAMILIES, default="A")
    asked = parser.parse_args(arguments)
    slips = [each for each in asked.method if asked.family != "C" or each not in OF_SINES]
    jobs = [*product(slips, range(asked.robots), [asked.family], [asked.seed])]
    write(asked, _asked, jobs, _table)


def _asked(job: tuple[str, int, str, int]) -> list[Answer]:
    name, number, family, seed = job
    logs, rng = list(draw_robot(family, number, seed).logs), np.random.default_rng([seed, number])
    slipped = CASES[name].make(logs, rng) if name in CASES else logs
    answer = ask(slipped, family)
    named = name in CASES and answer.recognised and names_it(name, logs, slipped, answer.text)
    return [replace(answer, slip=name, named=named)]


def _table(answers: list[Answer]) -> str:
    lines = []
    for name in dict.fromkeys(each.slip for each in answers):
        own = [each for each in answers if each.slip == name]
        recognised, named = sum(x.recognised for x in own), sum(x.named for x in own)
        said = dict(Counter(each.standing for each in own))
        lines.append(f"{name:15s} recognised {recognised}, named {named} of {len(own)}: {said}")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
