"""Identify joints as others log them, beside the best that their logs allow: ``make strangers``.

python -m tests.benchmarks.strangers --robots 60 --seed 1
python -m tests.benchmarks.strangers --kind free --of 7 12 --json FILE.json
"""

import json
import tempfile
import time
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

import numpy as np

import butterfly as bf
from butterfly.errors import ButterflyError
from butterfly.model.terms import PARAMETERS
from butterfly.verdict import Level
from tests.benchmarks.coverage import each_met, options
from tests.benchmarks.kept import command, keep
from tests.independent.strangers import KINDS, bound, draw

TOLD = 20.0
"""Bound in % of the inertia under which logs are asked for it."""

OFF = (10.0, 5.0)
"""Errors in % of the inertia that are counted."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What is said of p1 of a robot, in % of its true value; ``refused`` says why nothing is."""

    level: str = ""
    refused: str = ""
    reason: str = ""  # why it is not good
    error: float = float("nan")
    half_width: float = float("nan")
    misfit: float = float("nan")  # what is left over what sensors explain
    fit: float = float("nan")  # median, in %
    terms: str = ""  # beside the common ones
    seconds: float = 0.0  # of CPU

    @property
    def inside(self) -> bool:
        """Whether the interval holds the truth."""
        return abs(self.error) <= self.half_width

    @property
    def answered(self) -> bool:
        """Whether it is good, or to be used with care."""
        return self.level in {Level.GOOD.name, Level.CARE.name}

    def __str__(self) -> str:
        """One line."""
        if self.refused:
            return f"refused in {self.seconds:.1f} s: {self.refused}"
        held = "inside" if self.inside else "OUTSIDE"
        reason = f" ({self.reason})" if self.reason else ""
        return (
            f"{self.level}{reason}, p1 {self.error:+.2g} ± {self.half_width:.2g} % {held}; misfit "
            f"{self.misfit:.3g}, FIT {self.fit:.1f} %, [{self.terms}], {self.seconds:.1f} s"
        )


@dataclass(frozen=True, kw_only=True)
class Meeting:
    """A robot, what its logs could tell at best, and what is answered."""

    kind: str
    number: int
    what: str
    logs: int
    duration: float  # s, of a log
    bound: float  # %
    answer: Answer
    weak: Answer | None  # of the weak form, where there is no other

    def __str__(self) -> str:
        """One line."""
        weak = f"; weak form: {self.weak}" if self.weak else ""
        return (
            f"{self.kind} {self.number}, {self.what}, {self.logs} of {self.duration:.0f} s, bound "
            f"{self.bound:.2g} %: {self.answer}{weak}"
        )


def main(arguments=None):
    """Meet who was asked for, print a line of each and a summary, and keep what is asked for."""
    parser = options(__doc__, (), 30)
    parser.add_argument("--kind", nargs="*", choices=KINDS, default=list(KINDS))
    parser.add_argument("--of", type=int, nargs="*", help="numbers of the robots, instead")
    asked = parser.parse_args(arguments)
    jobs = [(*job, asked.seed) for job in product(asked.kind, asked.of or range(asked.robots))]
    met = each_met(meet, jobs, asked.workers)
    text = summary(met)
    print(text)
    keep("strangers", f"```text\n{text.strip()}\n```", command())
    if asked.json:
        Path(asked.json).write_text(json.dumps([*map(asdict, met)], indent=1), encoding="utf-8")


def meet(kind: str, number: int, seed: int) -> Meeting:
    """Identify a robot as its owner would; by the weak form too if there is no answer."""
    robot = draw(kind, number, seed)
    true = robot.truth["p1"]
    with tempfile.TemporaryDirectory() as folder:
        robot.write(Path(folder))
        answer = answered(folder, true)
        weak = None if answer.answered else answered(folder, true, "weak-form")
    return Meeting(
        kind=kind,
        number=number,
        what=robot.kind,
        logs=len(robot.recordings),
        duration=float(robot.recordings[0].time[-1]),
        bound=100.0 * bound(robot),
        answer=answer,
        weak=weak,
    )


def answered(folder: str, true: float, *method: str) -> Answer:
    """Return what is said of p1; a refusal or a crash is an answer too."""
    began = time.process_time()
    try:
        found = bf.identify(folder, *method)
    except ButterflyError as refusal:
        said = str(refusal).replace(f"{folder}/", "")
    except Exception as crash:  # it is counted, not hidden
        said = f"{type(crash).__name__}: {crash}"
    else:
        seconds, estimate = time.process_time() - began, found.estimate
        row = estimate.names.index("p1")
        value, lower, upper = (
            float(each[row]) for each in (estimate.values, estimate.lower, estimate.upper)
        )
        return Answer(
            level=found.judged.level.name,
            reason="" if found.judged.level is Level.GOOD else found.judged.reasons[0],
            error=100.0 * (value / true - 1.0),
            half_width=50.0 * (upper - lower) / true,
            misfit=float(found.residuals.times or np.nan),
            fit=float(found.fit.median),
            terms=" ".join(name for name in estimate.names if name not in PARAMETERS),
            seconds=seconds,
        )
    return Answer(refused=said, seconds=time.process_time() - began)


def summary(met: list[Meeting]) -> str:
    """Return a paragraph of counts for each kind."""
    kinds = dict.fromkeys(each.kind for each in met)
    return "\n".join(_counts(kind, [each for each in met if each.kind == kind]) for kind in kinds)


def _counts(kind, met):
    asked = [each for each in met if each.bound < TOLD]
    answered = [each for each in asked if each.answer.answered]
    valued = [each.answer for each in met if not each.answer.refused]
    given = [each.answer for each in met if each.answer.answered]
    known = [each for each in met if each.weak and each.weak.answered and each.weak.inside]
    numbers = f" (numbers {', '.join(str(each.number) for each in known)})" if known else ""
    off = ", ".join(
        f"{sum(abs(each.error) > most for each in given)} by more than {most:g} %" for most in OFF
    )
    seconds = [each.answer.seconds for each in met]
    width = np.median([each.half_width for each in given]) if given else np.nan
    return (
        f"\n{kind}: {len(met)} robots\n"
        f"  bound under {TOLD:g} %: {len(asked)}; of these answered: {len(answered)} "
        f"({100 * len(answered) / max(len(asked), 1):.0f} %)\n"
        f"  p1 inside: {sum(each.inside for each in given)} of {len(given)} answers, "
        f"{sum(each.inside for each in valued)} of {len(valued)} with those not to be used\n"
        f"  p1 of an answer off: {off}; median half-width {width:.2g} %\n"
        f"  without an answer where the weak form is right: {len(known)}{numbers}\n"
        f"  CPU: median {np.median(seconds):.1f} s, longest {max(seconds):.1f} s"
    )


if __name__ == "__main__":
    main()
