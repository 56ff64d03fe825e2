"""Peak memory of each command on the 41 real logs, into docs/performance.md.

`make memory`; without the real logs, by `BUTTERFLY_LOGS`, there is nothing to measure. On Linux.
"""

import os
import sys
import tempfile
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "performance.md"
BEGIN, END = "<!-- table: make memory -->", "<!-- end of memory -->"
DATA = "real-logs"
TO_THE_END = ("--budget", "0")
COMMANDS = (
    ("inspect", DATA),
    ("identify", DATA, "--save", "{saved}"),
    ("identify", DATA, "-m", "weak-form"),
    ("identify", DATA, "-m", "output-error", *TO_THE_END),
    ("identify", DATA, "--report", "{page}"),
    ("select", DATA, "-m", "output-error", *TO_THE_END),
    ("validate", DATA),
    ("validate", DATA, "--bootstrap", "200", *TO_THE_END),
    ("residual", DATA),
    ("predict", DATA, "--with", "{saved}", "--bands", *TO_THE_END),
    ("compare", DATA),
    ("design", DATA),
    ("reproduce", "thesis"),
    ("run", "quickstart", "--out", "{run}"),
)


def used(*words):
    """Return the CPU time in s and the peak memory in MB of one command."""
    silence = [(os.POSIX_SPAWN_OPEN, fd, os.devnull, os.O_WRONLY, 0) for fd in (1, 2)]
    command = [sys.executable, "-m", "butterfly", *words]
    child = os.posix_spawn(sys.executable, command, os.environ, file_actions=silence)
    _, status, found = os.wait4(child, 0)
    if os.waitstatus_to_exitcode(status) not in {0, 3}:
        raise SystemExit(f"butterfly {' '.join(words)} failed")
    return found.ru_utime + found.ru_stime, found.ru_maxrss / 1024


def main():
    """Measure all commands, and write the table."""
    rows = ["| command | peak memory |", "| --- | --- |"]
    with tempfile.TemporaryDirectory() as folder:
        places = {"saved": "saved.json", "page": "page.html", "run": "run"}
        places = {name: f"{folder}/{file}" for name, file in places.items()}
        used("identify", DATA, "-m", "output-error")  # compiles
        for words in COMMANDS:
            seconds, megabytes = used(*(word.format(**places) for word in words))
            kept = (word for word in words if word[0] != "{" and word not in TO_THE_END)
            shown = " ".join(kept)
            rows.append(f"| `butterfly {shown}` | {megabytes:.0f} MB |")
            print(f"{rows[-1]} {seconds:.1f} s of CPU", flush=True)
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    table = "\n".join(rows)
    PAGE.write_text(f"{before}{BEGIN}\n{table}\n{END}{rest.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    main()
