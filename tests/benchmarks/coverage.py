"""Identify random robots and print how often the intervals hold the truth: ``make coverage``.

python -m tests.benchmarks.coverage --family ABC --robots 100 --seed 1
python -m tests.benchmarks.coverage --family A --repeats 40 --of 7   # one robot, new noise
"""

import argparse
import json
import math
import os
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from itertools import product
from pathlib import Path

import numpy as np

from butterfly.model.terms import PARAMETERS
from tests.benchmarks.kept import command, keep
from tests.independent.robots import FAMILIES, draw
from tests.independent.scores import METHODS, Score, score

_NAMED = 4  # robots of one refusal


def main(arguments=None):
    """Score, print, and write what was asked for."""
    parser = options(__doc__, METHODS, 100)
    parser.add_argument("--family", default=FAMILIES, help="letters of the families")
    parser.add_argument("--repeats", type=int, default=0, help="of one robot, with new noise")
    parser.add_argument("--of", type=int, default=0, help="number of that robot")
    asked = parser.parse_args(arguments)
    robots = [(asked.of, k) for k in range(asked.repeats)] if asked.repeats else None
    jobs = [
        (family, number, asked.seed, repeat, asked.method)
        for family in asked.family
        for number, repeat in robots or [(k, 0) for k in range(asked.robots)]
    ]
    write("coverage", asked, _score_robot, jobs, report)


def each_met(meet, jobs, workers):
    """Meet what each job makes, in workers; print each as it comes, and return all."""
    met = []
    with ProcessPoolExecutor(workers) as pool:
        for one in pool.map(meet, *zip(*jobs, strict=True)):
            met.append(one)
            print(one, flush=True)
    return met


def options(doc, methods, robots):
    """What the programs that score robots have in common."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("--robots", type=int, default=robots, help="of each family or kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", nargs="*", choices=methods, default=list(methods))
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--json", help="file for all scores")
    return parser


def asked_of_kinds(arguments, doc, methods, robots, kinds):
    """Return what is asked of robots of kinds, and its jobs: kind, number, method and seed."""
    parser = options(doc, methods, robots)
    parser.add_argument("--kind", nargs="*", choices=kinds, default=list(kinds))
    parser.add_argument("--of", type=int, nargs="*", help="numbers of the robots, instead")
    asked = parser.parse_args(arguments)
    numbers = asked.of or range(asked.robots)
    return asked, [(*job, asked.seed) for job in product(asked.kind, numbers, asked.method)]


def write(name, asked, function, jobs, *reports):
    """Score by a function from a job to its scores, print reports, and keep what is asked for."""
    scores = []
    with ProcessPoolExecutor(asked.workers) as pool:
        for done, more in enumerate(pool.map(function, jobs), 1):
            scores += more
            print(f"\r{done}/{len(jobs)}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    text = "\n".join(each(scores) for each in reports)
    print(text)
    keep(name, text, command())
    if asked.json:
        rows = json.dumps([asdict(each) for each in scores], indent=1)
        Path(asked.json).write_text(rows, encoding="utf-8")


def _score_robot(job):
    family, number, seed, repeat, methods = job
    chosen = [name for name in methods if family in METHODS[name][1]]
    robot = draw(family, number, seed, repeat) if chosen else None
    return [score(robot, name) for name in chosen]


def grouped(scores):
    """Scores by family and method."""
    groups = {}
    for each in scores:
        groups.setdefault((each.family, each.method), []).append(each)
    return groups


def report(scores: list[Score]) -> str:
    """Return the tables and lists as text."""
    groups = grouped(scores)
    coverage = {key: _cells(rows, _coverage) for key, rows in groups.items()}
    cells = [cell for row in coverage.values() for cell in row if np.isfinite(cell)]
    most = max(len(rows) for rows in groups.values())
    parts = [
        _table("coverage of 95 % intervals in %", coverage, "{:.0f}"),
        f"mean of these cells: {np.mean(cells):.1f} %; a cell of {most} robots that is truly 95 % "
        f"strays by {100 * math.sqrt(0.95 * 0.05 / most):.1f} %",
        _table(
            "median error in % (delay ms)",
            {key: _cells(rows, _median_error) for key, rows in groups.items()},
            "{:.2g}",
        ),
        _table(
            "median half-width in % (delay ms)",
            {key: _cells(rows, median_half_width) for key, rows in groups.items()},
            "{:.2g}",
        ),
        _table(
            "median half-width over median error",
            {key: _cells(rows, _sharpness) for key, rows in groups.items()},
            "{:.1f}",
        ),
        _endings(groups),
        "known within 10 % as it says, and off by more:",
        *_false_claims(scores),
        "local minima:",
        *_local_minima(scores),
        "refused:",
        *_refusals(scores),
    ]
    return "\n".join(parts)


def _cells(rows, statistic):
    return [
        statistic([each.readings[name] for each in rows if name in each.readings])
        for name in PARAMETERS
    ]


def _coverage(readings):
    return 100.0 * np.mean([each.covered for each in readings]) if readings else np.nan


def _median_error(readings):
    return np.median([abs(each.error) for each in readings]) if readings else np.nan


def median_half_width(readings):
    """Median half-width of intervals; NaN of none."""
    return np.median([each.half_width for each in readings]) if readings else np.nan


def _sharpness(readings):
    return median_half_width(readings) / _median_error(readings)


def _table(title, rows, form):
    lines = [f"\n| {title} | {' | '.join(PARAMETERS)} |", "|---" * (len(PARAMETERS) + 1) + "|"]
    for (family, method), cells in rows.items():
        numbers = " | ".join(form.format(cell) if np.isfinite(cell) else "–" for cell in cells)
        lines.append(f"| {family} {method} | {numbers} |")
    return "\n".join(lines)


def _endings(groups):
    heads = (
        *("robots", "FIT", "condition", "claims", "missed", "false", "local minima", "refused"),
        *("flagged", "s each", "endings, verdicts"),
    )
    lines = [f"\n| what was said | {' | '.join(heads)} |", "|---" * (len(heads) + 1) + "|"]
    for (family, method), rows in groups.items():
        found = [each for each in rows if not each.refused]
        readings = [reading for each in found for reading in each.readings.values()]
        claims = [each for each in readings if each.claimed]
        said = Counter(word for each in found for word in (each.ending, each.verdict) if word)
        cells = (
            len(rows),
            f"{np.median([each.fit for each in found]):.2f}" if found else "",
            f"{np.median([each.condition for each in found]):.0f}" if found else "",
            len(claims),
            sum(not each.covered for each in claims),
            sum(each.false_claim for each in claims),
            sum(each.local_minimum for each in found),
            len(rows) - len(found),
            sum(each.flagged for each in found),
            f"{np.mean([each.seconds for each in rows]):.2f}",
            ", ".join(f"{word} {count}" for word, count in said.items()),
        )
        lines.append(f"| {family} {method} | {' | '.join(map(str, cells))} |")
    return "\n".join(lines) + "\n"


def _false_claims(scores):
    for each, name in product(scores, PARAMETERS):
        reading = each.readings.get(name)
        if reading and reading.false_claim:
            off, covered = 100 * reading.miss, "" if not reading.covered else ", but covered"
            verdict = f", {each.verdict}" if each.verdict else ""
            yield (
                f"  {each.name} {each.method}: {name} off by {off:.0f} %{covered}, "
                f"FIT {each.fit:.1f} %{verdict}"
            )


def _local_minima(scores):
    for each in scores:
        if each.local_minimum:
            worst = max(each.readings, key=lambda name: each.readings[name].miss)
            yield (
                f"  {each.name} {each.method}: cost {each.excess:.3g} times that of a fit begun at "
                f"the truth, {each.ending}, FIT {each.fit:.1f} %, {worst} off by "
                f"{100 * each.readings[worst].miss:.0f} %"
            )


def _refusals(scores):
    """Those of one text together."""
    texts = {}
    for each in scores:
        if each.refused:
            texts.setdefault(each.refused, []).append(f"{each.name} {each.method}")
    for text, names in texts.items():
        more = ", ..." * (len(names) > _NAMED)
        yield f"  {len(names)} times, {', '.join(names[:_NAMED])}{more}: {text}"


if __name__ == "__main__":
    main()
