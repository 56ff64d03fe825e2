"""Identify random robots on defective benches, and tell what holds and what is named of each row.

python -m tests.independent.bench --robots 20 --seed 1 --json FILE.json
python -m tests.independent.bench --rows base clock --method output-error --against FILE.json

A cause is asked for where the parameters that the defect moves are off by more than `MOVED` in the
answers of ``--against``, or in these: in the verdict, and (in brackets) anywhere.
"""

import json
import re
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

import butterfly as bf
from butterfly.model.terms import PARAMETERS
from butterfly.verdict import Level
from tests.benchmarks.coverage import grouped, median_half_width, options, write
from tests.independent.defects import ROWS, draw
from tests.independent.scores import Reading, Score, scored

MOVED = 2.0
"""Error in % of a parameter that a defect has moved."""

_GIVEN = "The logs cannot show errors of"  # begins a line that names what no log shows
_KEY = ("p1", "p4")  # what *good* vouches for


def main(arguments=None):
    """Score, write and print what was asked for."""
    parser = options(__doc__, ("auto", "harmonic-balance", "output-error"), 20)
    parser.set_defaults(method=["auto"])
    parser.add_argument("--rows", nargs="*", choices=ROWS, default=list(ROWS))
    parser.add_argument("--against", type=Path, help="such a file of another version, same seed")
    parser.add_argument("--table", type=Path, help="make the table of such a file, score nothing")
    asked = parser.parse_args(arguments)
    report = partial(table, against=read(asked.against) if asked.against else [])
    if asked.table:
        print(report(read(asked.table)))
        return
    jobs = product(asked.rows, range(asked.robots), asked.method, [asked.seed])
    write(asked, _score_job, list(jobs), report)


def _score_job(job):
    row, number, method, seed = job
    robot = draw(row, number, seed)
    found = scored(
        lambda: bf.identify(robot.logs, method),
        robot.truth,
        robot.heaviest,
        lambda found: {"misfit": found.residuals.times, "text": "\n".join(found.paragraphs())},
        family=row,
        number=number,
        repeat=0,
        method=method,
    )
    return [found]


def read(path):
    """Scores of a file."""
    rows = json.loads(path.read_text(encoding="utf-8"))
    return [
        Score(**row | {"readings": {k: Reading(**each) for k, each in row["readings"].items()}})
        for row in rows
    ]


def table(scores: list[Score], against: list[Score] = ()) -> str:
    """Return a line for each row; the widths are over those of another version, if it is given."""
    others = {(each.family, each.method, each.number): each for each in against}
    heads = (
        *("bench", "robots", "refused", *PARAMETERS, "width p1", "p4", "width over"),
        *("misfit", "FIT", "flagged", "good", "good with p1 or p4 outside", "named", "s"),
    )
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for (row, method), asked in grouped(scores).items():
        lines.append(f"| {' | '.join(map(str, _cells(row, method, asked, others)))} |")
    return "\n".join(lines)


def _cells(row, method, asked, others):
    found = [each for each in asked if not each.refused]
    name = row if method == "auto" else f"{row} {method}"
    yield from (name, len(asked), len(asked) - len(found))
    for name in PARAMETERS:
        covered = [each.readings[name].covered for each in found if name in each.readings]
        yield f"{100 * np.mean(covered):.0f}" if covered else ""
    for name in _KEY:
        width = median_half_width([each.readings[name] for each in found if name in each.readings])
        yield f"{width:.2g} %"
    pairs = [(each, others.get((row, method, each.number))) for each in found]
    ratios = [
        np.median(
            [now.readings[name].half_width / then.readings[name].half_width for now, then in both]
        )
        for name in PARAMETERS
        if (both := [pair for pair in pairs if pair[1] and _wide(pair, name)])
    ]
    yield " ".join(f"{each:.2f}" for each in ratios)
    yield f"{np.median([each.misfit for each in found]):.3g}" if found else ""
    yield f"{np.median([each.fit for each in found]):.2f}" if found else ""
    yield sum(each.flagged for each in found)
    good = [each for each in found if each.verdict == Level.GOOD.verdict]
    outside = [worst for each in good if (worst := _outside(each))]
    yield f"{len(good)}/{len(found)}"
    yield f"{len(outside)}" + (f", up to {max(outside):.2g} %" if outside else "")
    wrong = [each for each, then in pairs if moved(each) or (then and moved(then))]
    first, anywhere = (sum(names_cause(each, part) for each in wrong) for part in (2, None))
    yield f"{first} ({anywhere})/{len(wrong)}" if ROWS[row].words else ""
    yield f"{np.median([each.seconds for each in asked]):.2f}"


def _wide(pair, name):
    """Whether both of two answers have an interval of a parameter."""
    return all(name in each.readings and each.readings[name].half_width for each in pair)


def _outside(each):
    """Largest error in % of what *good* vouches for and an interval does not hold; else 0."""
    readings = [each.readings[name] for name in _KEY if name in each.readings]
    return max((abs(one.error) for one in readings if not one.covered), default=0.0)


def moved(each):
    """Whether a defect has moved what it moves."""
    names = (name for name in ROWS[each.family].moved if name in each.readings)
    return any(abs(each.readings[name].error) > MOVED for name in names)


def names_cause(each, count=None):
    """Whether the words of an answer name the cause, or an alias; its verdict has two lines."""
    lines = [line for line in each.text.splitlines()[:count] if not line.startswith(_GIVEN)]
    return bool(re.search(ROWS[each.family].words, "\n".join(lines), re.IGNORECASE))


if __name__ == "__main__":
    main()
