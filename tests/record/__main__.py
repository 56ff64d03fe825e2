"""Record what the program answers, digit by digit, and compare two records.

python -m tests.record write build/record.json --part quick
python -m tests.record compare old.json new.json --relative 1e-9
"""

import argparse
import json
import math
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from tests.record import program
from tests.record.cases import cases, places, prepare
from tests.record.comparing import compare


def main(arguments=None):
    """Write a record, or compare two; 1 if they differ."""
    asked = _options().parse_args(arguments)
    if asked.verb == "write":
        record = write(asked.part, asked.robots, asked.workers)
        asked.file.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(record, sort_keys=True, indent=1, ensure_ascii=False, allow_nan=False)
        asked.file.write_text(text + "\n", encoding="utf-8")
        return 0
    records = [json.loads(file.read_text(encoding="utf-8")) for file in (asked.old, asked.new)]
    lines, differs = compare(*records, asked.relative, words=asked.words)
    print("\n".join(lines))
    return int(differs)


def _options():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    writing = verbs.add_parser("write")
    writing.add_argument("file", type=Path)
    writing.add_argument("--part", choices=["quick", "full"], default="full")
    writing.add_argument("--robots", type=int, default=20, help="of each family and kind")
    writing.add_argument("--workers", type=int, default=2)
    comparing = verbs.add_parser("compare")
    comparing.add_argument("old", type=Path)
    comparing.add_argument("new", type=Path)
    comparing.add_argument("--relative", type=float, default=1e-9)
    comparing.add_argument("--words", action="store_true", help="list changed sentences too")
    return parser


def write(part, robots, workers):
    """Return the facts of all cases by their names."""
    record = {}
    with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(workers) as pool:
        prepare(Path(folder), part)
        asked = cases(Path(folder), part, robots)
        groups = {}
        for name, case in asked.items():
            groups.setdefault(name.rpartition("/")[0], {})[name] = case
        running = [pool.submit(_recorded, group, places(folder)) for group in groups.values()]
        for done in as_completed(running):
            for name, (facts, seconds) in done.result().items():
                record[name] = facts
                said = f"{len(record)}/{len(asked)} {seconds:6.1f} s {name}"
                print(said, file=sys.stderr, flush=True)
    return record


def _recorded(group, named):
    """Return what each case of a group says as JSON can hold it, and the seconds that it took."""
    found = {}
    for name, case in group.items():
        began = time.perf_counter()
        try:
            facts = case()
        except Exception as error:  # a refusal is a fact, and a crash too
            facts = program.refused(error)
        found[name] = plain(facts, named), time.perf_counter() - began
    return found


def plain(content, named=()):
    """Return facts without types of NumPy, numbers that JSON lacks, and places of this machine."""
    if isinstance(content, dict):
        return {_text(key, named): plain(each, named) for key, each in content.items()}
    if isinstance(content, list | tuple):
        return [plain(each, named) for each in content]
    if isinstance(content, str):
        return _text(content, named)
    if content is None:
        return None
    number = float(content)
    return number if math.isfinite(number) else str(number)


def _text(text, named):
    said = str(text)
    for place in named:
        said = said.replace(place, "")
    return said


if __name__ == "__main__":
    sys.exit(main())
