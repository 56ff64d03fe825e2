"""Identify random joints of short runs and slow films: `make paces`.

python -m tests.benchmarks.paces --robots 60 --seed 1
python -m tests.benchmarks.paces --kind slow --of 7 --seed 3
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import butterfly as bf
from butterfly.verdict import Level
from tests.benchmarks.coverage import asked_of_kinds, grouped, write
from tests.independent.paces import KINDS, draw
from tests.independent.scores import Score, scored

METHODS = {"default": (), "weak-form": ("weak-form",)}
"""What is told to `butterfly.identify` besides the data."""

ANSWERED = {Level.GOOD.verdict, Level.CARE.verdict}
"""What an answer that may be used is called."""


def main(arguments=None):
    """Score, print, and write what was asked for."""
    asked, jobs = asked_of_kinds(arguments, __doc__, METHODS, 60, KINDS)
    write("paces", asked, _score_job, jobs, counts)


def _score_job(job):
    return [score(*job)]


def score(kind, number, method, seed):
    """Identify a robot as its owner would."""
    robot = draw(kind, number, seed)
    named = {"family": kind, "number": number, "repeat": 0, "method": method}
    with tempfile.TemporaryDirectory() as folder:
        robot.write(Path(folder))
        found = scored(lambda: bf.identify(folder, *METHODS[method]), robot.truth, 0.0, **named)
    refused = found.refused.replace(f"{folder}/", "")
    # the first reading is of what the logs are made for
    readings = {name: found.readings[name] for name in robot.asked if name in found.readings}
    return replace(found, refused=refused, readings=readings)


def counts(scores: list[Score]) -> str:
    """Return how many robots are answered, and how many answers hold the truth; who is missed."""
    lines = ["\n| kind | answered | inside | all inside | median ± % | s |", "|---" * 6 + "|"]
    missed = []
    for (kind, method), rows in grouped(scores).items():
        answered = [each for each in rows if each.verdict in ANSWERED]
        first = [next(iter(each.readings.values())) for each in rows if each.readings]
        whole = [all(reading.covered for reading in each.readings.values()) for each in answered]
        widths = sorted(each.half_width for each in first)
        half = f"{widths[len(widths) // 2]:.2g}" if widths else "–"
        seconds = sum(each.seconds for each in rows) / len(rows)
        lines.append(
            f"| {kind} {method} | {len(answered)}/{len(rows)} | "
            f"{sum(each.covered for each in first)}/{len(rows)} | "
            f"{sum(whole)}/{len(answered)} | {half} | {seconds:.1f} |"
        )
        missed += [line for each in rows if (line := _miss(each))]
    return "\n".join([*lines, "misses:", *missed])


def _miss(each: Score) -> str:
    """Return the line of a robot that is not answered, or whose first value is not inside."""
    if not each.readings:
        return f"{each.name} {each.method}: refused: {each.refused}"
    name, first = next(iter(each.readings.items()))
    if each.verdict in ANSWERED and first.covered:
        return ""
    said = f"{name} {first.error:+.3g} ± {first.half_width:.2g} %"
    return f"{each.name} {each.method}: {each.verdict}: {said}"


if __name__ == "__main__":
    main()
