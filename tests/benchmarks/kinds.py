"""Identify random robots of unknown kind and print how often the intervals hold the truth.

python -m tests.benchmarks.kinds --robots 20 --seed 1
python -m tests.benchmarks.kinds --kind slide wrapped --method default --seed 3
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

import butterfly as bf
from butterfly.model.terms import PARAMETERS
from tests.benchmarks.coverage import asked_of_kinds, grouped, report, write
from tests.independent.kinds import KINDS, draw
from tests.independent.scores import Score, scored

METHODS = {"default": (), "output-error": ("output-error",), "weak-form": ("weak-form",)}
"""What is told to `butterfly.identify` besides the data."""

ENOUGH = 0.8
"""Share of the robots of a kind whose interval must hold a parameter."""


def main(arguments=None):
    """Score, print, and write what was asked for."""
    asked, jobs = asked_of_kinds(arguments, __doc__, METHODS, 20, KINDS)
    write("kinds", asked, _score_job, jobs, report, counts)


def _score_job(job):
    return [score(*job)]


def score(kind, number, method, seed):
    """Identify a robot as its owner would."""
    robot = draw(kind, number, seed)
    asked = {name: value for name, value in robot.truth.items() if name not in robot.known}
    heaviest = robot.body.heaviest
    named = {"family": kind, "number": number, "repeat": 0, "method": method}
    with tempfile.TemporaryDirectory() as folder:
        robot.write(Path(folder))
        each = scored(lambda: bf.identify(folder, *METHODS[method]), asked, heaviest, **named)
    return replace(each, refused=each.refused.replace(f"{folder}/", ""))


def counts(scores: list[Score]) -> str:
    """Return how many robots of each kind are covered; a refusal covers nothing."""
    heads = " | ".join([*PARAMETERS, "pooled %", "enough"])
    lines = [f"\n| robots covered | {heads} |", "|---" * (len(PARAMETERS) + 3) + "|"]
    for (kind, method), rows in grouped(scores).items():
        held = {
            name: [each.readings[name].covered for each in rows if name in each.readings]
            for name in PARAMETERS
        }
        found = [covered for name in PARAMETERS for covered in held[name]]
        cells = [f"{sum(each)}/{len(each)}" if each else "–" for each in held.values()]
        refused = sum(bool(each.refused) for each in rows)
        shares = [sum(each) / (len(each) + refused) for each in held.values() if each]
        enough = bool(shares) and min(shares) >= ENOUGH
        pooled = f"{100 * np.mean(found):.1f}" if found else "–"
        lines.append(f"| {kind} {method} | {' | '.join([*cells, pooled, str(enough)])} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
