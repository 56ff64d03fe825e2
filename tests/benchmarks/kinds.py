"""Identify random robots of unknown kind and print how often the intervals hold the truth.

python -m tests.benchmarks.kinds --robots 20 --seed 1
python -m tests.benchmarks.kinds --kind slide wrapped --method default --seed 3
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from itertools import product
from pathlib import Path

import numpy as np

import butterfly as bf
from butterfly.errors import ButterflyError
from butterfly.model.terms import PARAMETERS
from tests.benchmarks.coverage import report
from tests.independent.kinds import KINDS, draw
from tests.independent.scores import Score, readings_of

METHODS = {"default": (), "output-error": ("output-error",), "weak-form": ("weak-form",)}
"""What is told to `butterfly.identify` besides the data."""

ENOUGH = 0.8
"""Share of the robots of a kind whose interval must hold a parameter."""


def main(arguments=None):
    """Score, print, and write what was asked for."""
    asked = _options().parse_args(arguments)
    numbers = asked.of or range(asked.robots)
    jobs = [(*job, asked.seed) for job in product(asked.kind, numbers, asked.method)]
    scores = []
    with ProcessPoolExecutor(asked.workers) as pool:
        for done, each in enumerate(pool.map(score, *zip(*jobs, strict=True)), 1):
            scores.append(each)
            print(f"\r{done}/{len(jobs)} identifications", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    print(report(scores))
    print(counts(scores))
    if asked.json:
        rows = json.dumps([asdict(each) for each in scores], indent=1)
        Path(asked.json).write_text(rows, encoding="utf-8")


def _options():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kind", nargs="*", choices=KINDS, default=list(KINDS))
    parser.add_argument("--robots", type=int, default=20, help="of each kind")
    parser.add_argument("--of", type=int, nargs="*", help="numbers of the robots, instead")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", nargs="*", choices=METHODS, default=list(METHODS))
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--json", help="file for all scores")
    return parser


def score(kind, number, method, seed):
    """Identify a robot as its owner would; a refusal or a crash is a score too."""
    robot = draw(kind, number, seed)
    with tempfile.TemporaryDirectory() as folder:
        robot.write(Path(folder))
        began = time.perf_counter()
        try:
            found = bf.identify(folder, *METHODS[method])
            judged = _judged(found, robot)
        except ButterflyError as refusal:
            judged = {"refused": str(refusal).replace(f"{folder}/", "")}
        except Exception as crash:  # it is counted, not hidden
            judged = {"refused": f"{type(crash).__name__}: {crash}"}
        seconds = time.perf_counter() - began
    return Score(family=kind, number=number, repeat=0, method=method, seconds=seconds, **judged)


def _judged(found, robot):
    estimate = found.estimate
    asked = {name: value for name, value in robot.truth.items() if name not in robot.known}
    return {
        "readings": readings_of(estimate, asked, robot.heaviest),
        "fit": found.fit.median,
        "condition": estimate.condition,
        "ending": str(estimate.ending),
        "verdict": str(found.standing),
    }


def counts(scores: list[Score]) -> str:
    """Return how many robots of each kind are covered; a refusal covers nothing."""
    groups = {}
    for each in scores:
        groups.setdefault((each.family, each.method), []).append(each)
    heads = " | ".join([*PARAMETERS, "pooled %", "enough"])
    lines = [f"\n| robots covered | {heads} |", "|---" * (len(PARAMETERS) + 3) + "|"]
    for (kind, method), rows in groups.items():
        held = {
            name: [each.readings[name].covered for each in rows if name in each.readings]
            for name in PARAMETERS
        }
        found = [covered for name in PARAMETERS for covered in held[name]]
        cells = [f"{sum(each)}/{len(each)}" if each else "" for each in held.values()]
        refused = sum(bool(each.refused) for each in rows)
        shares = [sum(each) / (len(each) + refused) for each in held.values() if each]
        enough = bool(shares) and min(shares) >= ENOUGH
        pooled = f"{100 * np.mean(found):.1f}" if found else ""
        lines.append(f"| {kind} {method} | {' | '.join([*cells, pooled, str(enough)])} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
