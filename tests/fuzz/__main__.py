"""Damage files of each kind, read them in a child, and count what is neither done nor a line.

Of those that have an answer (see `tests.fuzz.answers`) the outcomes are counted too.

python -m tests.fuzz --cases 5000 --seed 7
"""

import argparse
import random
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

try:
    import resource
except ImportError:  # Windows has none
    resource = None  # type: ignore[assignment]

from tests.fuzz.answers import KINDS as ANSWERED
from tests.fuzz.answers import is_escape
from tests.fuzz.damage import damaged
from tests.fuzz.kinds import KINDS, sounds_of

SLOW = 5.0
"""Seconds of CPU that a case may take."""

ROOM = 1 << 30
"""Bytes that a case may take."""


def main() -> int:
    """Run all kinds; the exit code says whether anything escaped."""
    asked = _options().parse_args()
    if asked.child is not None:
        _child(asked.child, asked.cases, asked.seed, asked.begin)
        return 0
    escaped = 0
    for kind in asked.kind:
        found = _counted(kind, asked.cases, asked.seed)
        escapes = Counter({each: count for each, count in found.items() if is_escape(each)})
        ended = Counter(each.partition(":")[0] for each in (found - escapes).elements())
        words = [f"{count} {each}" for each, count in ended.most_common()]
        counted = [f"{asked.cases} cases", f"{escapes.total()} escapes", *words]
        print(f"{kind}: {', '.join(counted)}", flush=True)
        for each, count in found.most_common():
            if each in escapes or ":" in each:
                print(f"  {count} times, {each}", flush=True)
        escaped += escapes.total()
    return int(escaped > 0)


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=1000, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", nargs="*", choices=KINDS, default=KINDS)
    parser.add_argument("--child", choices=KINDS, help=argparse.SUPPRESS)
    parser.add_argument("--begin", type=int, default=0, help=argparse.SUPPRESS)
    return parser


def _counted(kind: str, cases: int, seed: int) -> Counter[str]:
    """Count escapes; one that ends the child counts, and the next child goes on behind it."""
    escapes: Counter[str] = Counter()
    begin = 0
    while begin < cases:
        told = ("--child", kind, "--cases", cases, "--seed", seed, "--begin", begin)
        words = [sys.executable, "-m", "tests.fuzz", *map(str, told)]
        done = subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603
        lines = done.stdout.splitlines()
        escapes.update(line.partition(" ")[2] for line in lines if " " in line)
        if done.returncode == 0:
            break
        last = int(lines[-1].partition(" ")[0]) if lines else begin
        escapes[f"the process ended with {done.returncode} {done.stderr[-200:]}"] += 1
        begin = last + 1
    return escapes


def _bound_memory() -> None:
    """Let no case take more than `ROOM` beyond what is taken by now, where the system can."""
    if resource is None or not Path("/proc/self/statm").exists():
        return
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    taken = pages * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + ROOM, resource.RLIM_INFINITY))


def _child(kind: str, cases: int, seed: int, begin: int) -> None:
    """Print the number of each case before it, and what escaped after it."""
    warnings.simplefilter("error")
    sounds = sounds_of(kind)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "damaged"
        if kind in ANSWERED:  # what only a first answer costs counts for none
            for sound, outcome in sounds:
                assert outcome(sound, path) == "same"
        _bound_memory()
        for number in range(begin, cases):
            rng = random.Random(f"{kind} {seed} {number}")  # noqa: S311 - no secret
            sound, escapes = rng.choice(sounds)
            content = damaged(sound, rng)
            print(number, flush=True)
            before = time.process_time()
            escape = escapes(content, path)
            if time.process_time() - before > SLOW:
                escape = escape if is_escape(escape) else f"more than {SLOW:g} s"
            if escape:
                print(f"{number} {escape}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
