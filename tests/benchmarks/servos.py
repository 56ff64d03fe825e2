"""Identify random servos in their loops and print how often the intervals hold the truth.

python -m tests.benchmarks.servos --robots 20 --seed 1 --json FILE.json
python -m tests.benchmarks.servos --law odrive moteus --way setpoint voltage constant gear
"""

import tempfile
from collections import Counter
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

import butterfly as bf
from butterfly.model.terms import PARAMETERS
from butterfly.verdict import Level
from tests.benchmarks.coverage import grouped, options, report, write
from tests.independent.scores import scored
from tests.independent.servos import LAWS, SLIPS, draw

WAYS = ("setpoint", "drive", *SLIPS)
"""What the owner tells: goals and loop, what the firmware sent, or a slip."""

GAINS = ("loop_kp", "loop_ki", "loop_kd")
FRICTION = ("back_emf", "stribeck", "stribeck_velocity", "motor_friction", "load_friction")
ASKED = (*PARAMETERS, *FRICTION, *GAINS)

NAMED = {"voltage": ("input: setpoint",), "constant": ("gain",), "gear": ("gear",)}
"""Words of an answer that names the slip."""


def main(arguments=None):
    """Score, print, and write what was asked for."""
    parser = options(__doc__, {"default": ()}, 20)
    parser.add_argument("--law", nargs="*", choices=LAWS, default=list(LAWS))
    parser.add_argument("--way", nargs="*", choices=WAYS, default=["setpoint"])
    parser.add_argument("--of", type=int, nargs="*", help="numbers of the servos, instead")
    parser.add_argument("--terms", nargs="*", help="that are fitted, instead of a choice")
    asked = parser.parse_args(arguments)
    told = {} if asked.terms is None else {"terms": asked.terms}
    numbers = asked.of or range(asked.robots)
    jobs = [(*job, asked.seed, told) for job in product(asked.law, numbers, asked.way)]
    write("servos", asked, _score_job, jobs, report, counts)


def _score_job(job):
    return [score(*job)]


def score(law, number, way, seed, told=None):
    """Identify a servo as its owner would."""
    servo = draw(law, number, seed)
    truth = {name: value for name, value in servo.truth.items() if name not in servo.known}
    if way == "drive":  # what the firmware sent is what the motor gets
        truth["delay"] = 0.0
    truth |= servo.gains if way == "setpoint" else {}
    named = {"family": law, "number": number, "repeat": 0, "method": way}
    with tempfile.TemporaryDirectory() as folder:
        servo.write(Path(folder), way)
        each = scored(
            lambda: bf.identify(folder, *(("output-error",) if told else ()), **(told or {})),
            truth,
            servo.heaviest,
            lambda found: {"text": "\n".join(found.paragraphs())},
            names=ASKED,
            **named,
        )
    return replace(each, refused=each.refused.replace(f"{folder}/", ""))


def counts(scores):
    """Return what is covered of each law and way, what is refused, claimed, said and named."""
    heads = ("law", "robots", "refused", *ASKED, "pooled", "false claims", "verdicts", "named")
    lines = [f"\n| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for (law, way), rows in grouped(scores).items():
        found = [each for each in rows if not each.refused]
        held = {
            name: [each.readings[name].covered for each in found if name in each.readings]
            for name in ASKED
        }
        pooled = [covered for each in held.values() for covered in each]
        claims = sum(x.false_claim for each in found for x in each.readings.values())
        said = Counter(each.verdict for each in found)
        named = sum(names_it(each) for each in rows) if way in SLIPS else ""
        accused = [k for k in SLIPS if sum(_has(each, k) for each in rows)] if not named else []
        cells = (
            f"{law} {way}",
            len(rows),
            len(rows) - len(found),
            *(f"{sum(each)}/{len(each)}" if each else "" for each in held.values()),
            f"{100 * np.mean(pooled):.1f}" if pooled else "",
            claims,
            ", ".join(f"{count} {verdict}" for verdict, count in said.items()),
            f"{named}/{len(rows)}" if way in SLIPS else " ".join(accused),
        )
        lines.append(f"| {' | '.join(map(str, cells))} |")
    wrong = [each for each in scores if each.method in SLIPS and each.verdict == Level.GOOD.verdict]
    lines.append(f"slips called good: {[f'{each.name} {each.method}' for each in wrong]}")
    return "\n".join(lines)


def names_it(score):
    """Whether an answer, or a refusal, names the slip that was made."""
    return _has(score, score.method)


def _has(score, slip):
    said = (score.text or score.refused).lower()
    return all(word in said for word in NAMED[slip])


if __name__ == "__main__":
    main()
