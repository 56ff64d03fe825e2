"""How often runs of one mass are accused, and with another mass found: ``make repeats``."""

from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from types import SimpleNamespace

import numpy as np

from butterfly.campaigns.bench import Bench, Limits, SafetyStop
from butterfly.campaigns.plan import PROBE, candidates, probe, validation
from butterfly.identification.data import DataSet
from butterfly.identification.repeatability import Repeatability
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from tests.benchmarks.campaigns import Drawn
from tests.benchmarks.coverage import options, write

KINDS = ("grey-box", "mujoco", "drag", "stribeck", "bias", "cogging", "base")
MASSES = (NO_ADDED_MASS, *(AddedMass(mass=mass, arm=0.1) for mass in (0.05, 0.1, 0.2)))
STEPS = (1024, 8192, 65536)
"""Of encoders, one robot after the other."""
SHARES = (0.0, 0.06, 0.1, 0.2, 0.4, 1.0)
"""Edges of the shares of inertia by which two runs differ, in the table."""


@dataclass(frozen=True)
class Pair:
    """Two runs of a robot that are said to carry the same mass."""

    kind: str
    number: int
    played: str
    differs: float  # share of the larger inertia by which what they carried differs
    accused: bool


def main(arguments=None):
    """Record, compare all pairs, and print a table."""
    parser = options(__doc__, (), 20)
    parser.add_argument("--kind", nargs="*", choices=KINDS, default=KINDS)
    asked = parser.parse_args(arguments)
    jobs = [(kind, number, asked.seed) for kind in asked.kind for number in range(asked.robots)]
    write("repeats", asked, _pairs, jobs, report)


def _pairs(job):
    """Compare each run of a robot with each other one, as if they carried the same mass."""
    motor = Drawn(*job, steps=STEPS[job[1] % len(STEPS)], dry=0.4)
    played, logs = zip(*_runs(motor, np.random.default_rng(job[1:])), strict=True)
    data = DataSet.of([replace(log, added_mass=NO_ADDED_MASS) for log in logs])
    repeatability, pairs = Repeatability(), []
    for first, second in combinations(range(len(logs)), 2):
        inertias = [motor.true.p1 + logs[number].added_mass.inertia for number in (first, second)]
        accused = repeatability.contradiction(data.take([first, second]), 1) is not None
        names, differs = f"{played[first]}, {played[second]}", 1 - min(inertias) / max(inertias)
        pairs.append(Pair(*job[:2], played=names, differs=differs, accused=accused))
    return pairs


def _runs(motor, rng):
    """Play a probe, a relay, sines and a sum of sines with each mass; leave out what is stopped."""
    known, limits = SimpleNamespace(parameters=motor.true), Limits(command=motor.limit)
    size = 1.5 * motor.true.coulomb / motor.true.p4 + 0.05 * motor.limit
    with Bench(motor, limits, 0.004) as bench:
        bench.polarity = int(motor.sign)
        for mass in MASSES:
            bench.changed(lambda mass=mass: motor.carry(mass))
            others = rng.permutation(np.array(candidates(known, mass, limits), dtype=object))
            recipes = [probe(mass, size, limits, PROBE), validation(known, mass, limits)]
            for recipe in (*recipes, *others[:2]):
                try:
                    bench.settle()
                    run = bench.run(recipe.law(bench.home), recipe.duration, recipe.reach)
                except SafetyStop:
                    continue
                yield recipe.kind, run.log(added_mass=mass)


def report(pairs):
    """Return a table by kind: pairs accused of all, by how much their inertia differs."""
    edges = list(pairwise(SHARES))
    heads = [f"{100 * low:g} to {100 * high:g} %" for low, high in edges]
    lines = [f"| kind | sound | {' | '.join(heads)} |", "|---" * (len(heads) + 2) + "|"]
    for kind in dict.fromkeys(each.kind for each in pairs):
        mine = [each for each in pairs if each.kind == kind]
        groups = [[each for each in mine if each.differs == 0]]
        groups += [[e for e in mine if low < e.differs <= high] for low, high in edges]
        cells = (f"{sum(e.accused for e in group)} of {len(group)}" for group in groups)
        lines.append(f"| {kind} | {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
