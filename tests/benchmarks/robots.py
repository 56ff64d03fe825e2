"""Identify a joint of whole robots by their own files, beside what it truly has: ``make robots``.

python -m tests.benchmarks.robots --seed 1
python -m tests.benchmarks.robots --model arm --joint elbow --of 3 --logs build/elbow
"""

import json
import math
import tempfile
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

import butterfly as bf
from butterfly.errors import ButterflyError
from butterfly.model.terms import PARAMETERS
from butterfly.twin.model_rows import facts_of
from butterfly.verdict import Level
from tests.benchmarks.coverage import each_met, options
from tests.benchmarks.kept import command, keep
from tests.independent.robot_plants import Hidden
from tests.independent.whole_robots import FILES, Truth, draw, file_of

ASKED = ("p1", "armature", "damping", "frictionloss")
"""What is compared with the truth."""

FAR = 1.5
"""Half-widths, by more than which nothing good may be off."""

_CASES = 5  # of a joint


@dataclass(frozen=True, kw_only=True)
class Claim:
    """What is said of a quantity, beside the truth."""

    true: float
    value: float
    half_width: float

    @property
    def miss(self) -> float:
        """Error in half-widths."""
        return abs(self.value - self.true) / self.half_width if self.half_width else math.inf

    def __str__(self) -> str:
        """Value, half-width, truth and error in half-widths."""
        return f"{self.value:.4g} ± {self.half_width:.2g} (true {self.true:.4g}: {self.miss:.2f})"


@dataclass(frozen=True, kw_only=True)
class Case:
    """A joint, how it was logged, and what is said of it; ``refused`` says why nothing is."""

    model: str
    joint: str
    number: int
    others: str = ""
    known: str = ""
    stiff: bool = True
    what: str = ""
    level: str = ""
    refused: str = ""
    reason: str = ""  # why it is not good
    claims: dict[str, Claim] = field(default_factory=dict)
    fit: float = float("nan")  # median, in %
    misfit: float = float("nan")  # residuals over what sensors explain
    terms: str = ""  # beside the common ones
    seconds: float = 0.0  # of CPU

    @property
    def answered(self) -> bool:
        """Whether it is good, or to be used with care."""
        return self.level in {Level.GOOD.name, Level.CARE.name}

    @property
    def false(self) -> bool:
        """Whether it is good, and something is far outside its interval."""
        far = any(claim.miss > FAR for claim in self.claims.values())
        return self.level == Level.GOOD.name and far

    def __str__(self) -> str:
        """One line."""
        name = f"{self.model} {self.joint} {self.number}, {self.what}"
        if self.refused:
            return f"{name}: refused in {self.seconds:.1f} s: {self.refused}"
        claims = ", ".join(f"{asked} {claim}" for asked, claim in self.claims.items())
        reason = f" ({self.reason})" if self.reason else ""
        return (
            f"{name}: {'FALSE ' * self.false}{self.level}{reason}, {claims}; misfit "
            f"{self.misfit:.3g}, FIT {self.fit:.1f} %, [{self.terms}], {self.seconds:.1f} s"
        )


def main(arguments=None):
    """Meet who was asked for, print a line of each and a summary, and keep what is asked for."""
    parser = options(__doc__, (), _CASES)
    parser.add_argument("--model", nargs="*", choices=FILES, default=list(FILES))
    parser.add_argument("--joint", nargs="*", help="of these joints alone")
    parser.add_argument("--of", type=int, nargs="*", help="numbers of the cases, instead")
    parser.add_argument("--logs", help="folder of the logs: kept there, or drawn before")
    asked = parser.parse_args(arguments)
    jobs = []
    for model in asked.model:
        if file_of(model) is None:
            print(f"{model}: not installed (make robots installs it)")
            continue
        joints = [name for name in FILES[model].asked if not asked.joint or name in asked.joint]
        numbers = asked.of or range(asked.robots)
        jobs += [(model, name, k, asked.seed, asked.logs) for name in joints for k in numbers]
    met = each_met(meet, jobs, asked.workers)
    text = summary(met)
    print(text)
    keep("robots", text, command())
    if asked.json:
        Path(asked.json).write_text(json.dumps([*map(asdict, met)], indent=1), encoding="utf-8")


def meet(model: str, joint: str, number: int, seed: int = 1, kept: str | None = None) -> Case:
    """Identify a joint as its owner would; a refusal or a crash is an answer too."""
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(kept or temporary) / f"{model}-{joint}-{number}-seed-{seed}"
        robot, folder = _drawn(place, model, joint, number, seed), place / "logs"
        began, answer = time.process_time(), {}
        try:
            found = bf.identify(bf.read(folder, **robot.facts))
        except ButterflyError as refusal:
            answer = {"refused": str(refusal).replace(f"{folder}/", "")}
        except Exception as crash:  # it is counted, not hidden
            answer = {"refused": f"{type(crash).__name__}: {crash}"}
        else:
            answer = _answer(found, robot)
    return Case(
        model=model,
        joint=joint,
        number=number,
        others=robot.others,
        known=robot.known,
        stiff=robot.hidden.stiff,
        what=robot.what,
        seconds=time.process_time() - began,
        **answer,
    )


def _drawn(place, model, joint, number, seed):
    """Return the truth of a case whose logs are in a folder; they are drawn if they are not."""
    truth = place / "truth.json"
    if not truth.exists():
        robot = draw(model, joint, number, seed)
        (place / "logs").mkdir(parents=True, exist_ok=True)
        robot.write(place / "logs", seed)
        truth.write_text(json.dumps(asdict(robot.truth)), encoding="utf-8")
    content = json.loads(truth.read_text(encoding="utf-8"))
    return Truth(**content | {"hidden": Hidden(**content["hidden"])})


def _answer(found, robot):
    estimate = found.estimate
    return {
        "level": found.judged.level.name,
        "reason": "" if found.judged.level is Level.GOOD else found.judged.reasons[0],
        "claims": _claims(found, robot),
        "misfit": float(found.residuals.times or np.nan),
        "fit": float(found.fit.median),
        "terms": " ".join(name for name in estimate.names if name not in PARAMETERS),
    }


def _claims(found, robot):
    """Return what is said of each quantity that has an interval, with the truth."""
    hidden, estimate = robot.hidden, found.estimate
    links = hidden.masses * facts_of(found).bare[0]  # of several poses it is a part of each
    said = {
        row["attribute"]: (row["value"], row["lower"], row["upper"])
        for row in found.to_dict().get("model", [])
        if row["element"] == "joint" and row["lower"] is not None
    }
    if "p1" in estimate.names and "p1" not in estimate.open:
        row = estimate.names.index("p1")
        ends = estimate.values, estimate.lower, estimate.upper
        said["p1"] = tuple(float(each[row]) for each in ends)
    truth = {
        "p1": links + hidden.armature,
        "armature": hidden.armature - robot.rotors,
        "damping": hidden.damping,
        "frictionloss": hidden.frictionloss,
    }
    return {
        name: Claim(true=truth[name], value=value, half_width=(upper - lower) / 2.0)
        for name in ASKED
        if name in said
        for value, lower, upper in [said[name]]
    }


def summary(met: list[Case]) -> str:
    """Return a table by what the others do, by robot, and by joint, and what is false."""
    usual = [each for each in met if each.stiff]
    groups = {"all with stiff friction": usual}
    for each in met:
        groups.setdefault(each.others if each.stiff else "default friction", []).append(each)
    for each in usual:
        groups.setdefault(f"known {each.known}", []).append(each)
    for each in usual:
        groups.setdefault(each.model, []).append(each)
    for each in usual:
        groups.setdefault(f"{each.model} {each.joint}", []).append(each)
    heads = "cases | good | with care | not to be used | refused | false"
    lines = [
        f"| {' | '.join(['of answers, inside', *ASKED])} | all % | {heads} | s each |",
        "|---" * (len(ASKED) + 9) + "|",
        *(_row(name, rows) for name, rows in groups.items()),
        "",
        f"good, and off by more than {FAR:g} half-widths:",
        *(f"  {each}" for each in met if each.false),
    ]
    return "\n".join(lines)


def _row(name, rows):
    given = [each for each in rows if each.answered]
    inside = {
        asked: [each.claims[asked].miss <= 1.0 for each in given if asked in each.claims]
        for asked in ASKED
    }
    pooled = [held for each in inside.values() for held in each]
    cells = [
        *(f"{sum(held)}/{len(held)}" if held else "–" for held in inside.values()),
        f"{100.0 * np.mean(pooled):.0f}" if pooled else "–",
        len(rows),
        *(sum(each.level == level.name for each in rows) for level in (Level.GOOD, Level.CARE)),
        sum(not each.answered and not each.refused for each in rows),
        sum(bool(each.refused) for each in rows),
        sum(each.false for each in rows),
        f"{np.mean([each.seconds for each in rows]):.0f}",
    ]
    return f"| {name} | {' | '.join(map(str, cells))} |"


if __name__ == "__main__":
    main()
