"""Fit an XL330's logs without one of its gains, foretell those with it, and print how far off.

python -m tests.benchmarks.xl330 --logs FOLDER --terms motor_friction load_friction stribeck
python -m tests.benchmarks.xl330 --unknown      # the manual's law, its gains uncertain

Closed loop: simulated from the goal alone, mean absolute error of the angle. Open loop: simulated
on the rebuilt voltage, supply x clip(kp (goal - angle) 4096/(2 pi)/(256 x 885), -1, 1). The first
row of a table is of the logs that were left out, the others of one gain each.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np

import butterfly as bf
from butterfly.identification.free_run import FreeRun, Setting

GAINS = (100, 200, 800)
COLUMNS = ("time_s", "goal_rad", "angle_rad", "supply_V", "torque_enabled")
SHARED = Path(__file__).parents[3] / "shared/data/strangers/xl330"

_DUTY = 4096 / (2 * np.pi) / (256 * 885)


def main(arguments=None):
    """Fit and print what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--logs", type=Path, default=SHARED)
    parser.add_argument("--terms", nargs="*", help="that are fitted, instead of a choice")
    parser.add_argument("--method", default="output-error")
    parser.add_argument(
        "--unknown", action="store_true", help="tell the manual's law, and gains as uncertain"
    )
    parser.add_argument("--without", type=int, nargs="*", default=[*GAINS, 0], help="0: none")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args(arguments)
    told = {} if asked.terms is None else {"terms": asked.terms}
    found = {}
    for gain in asked.without:
        with tempfile.TemporaryDirectory() as folder:
            closed, opened = write(asked.logs, Path(folder), unknown=asked.unknown)
            began = time.process_time()
            held = [f"*kp{gain}.csv"] if gain else []
            made = bf.identify(closed, asked.method, holdout=held, **told)
            seconds = time.process_time() - began
            rows = {
                name: errors(made.estimate, file)
                for name, file in (("closed", closed), ("open", opened))
            }
        found[gain] = rows | {"seconds": seconds, "text": "\n".join(made.paragraphs())}
        print(f"\nwithout kp {gain or 'none'}, {seconds:.0f} s: {made.estimator}, {made.standing}")
        print(made)
        print(table(rows, gain))
    if asked.json:
        asked.json.write_text(json.dumps(found, indent=1), encoding="utf-8")


def write(source, folder, *, unknown=False):
    """Write manifests of the logs in their loop, and of their rebuilt voltages; return both."""
    entries, opened = [], []
    for file in sorted(source.glob("*.csv")):
        gain = float(file.stem.split("kp")[1])
        head = file.read_text(encoding="utf-8").splitlines()[0].split(",")
        rows = np.loadtxt(file, delimiter=",", skiprows=1)
        stamps, goal, angle, supply, enabled = (rows[:, head.index(name)] for name in COLUMNS)
        volts = supply * np.clip(gain * _DUTY * (goal - angle), -1.0, 1.0) * enabled
        columns = np.column_stack([stamps, goal, angle, supply, enabled, volts])
        name = {"header": ",".join((*COLUMNS, "volts")), "comments": ""}
        np.savetxt(folder / file.name, columns, fmt="%.9g", delimiter=",", **name)
        entry = {"file": file.name, "added_mass": 0.49}
        opened.append(entry)
        kp = {"value": gain, "uncertainty": 10.0 * gain} if unknown else gain
        entries.append(entry | {"loop": {"kp": kp}})
    names = dict(zip(("time", "input", "angle", "supply", "enabled"), COLUMNS, strict=True))
    both = {"name": "xl330", "arm": 0.1, "known": {"p3": 0.0}, "columns": names}
    files = folder / "closed.yaml", folder / "open.yaml"
    law = "dynamixel-x" if unknown else "dynamixel-xl330"  # the manual's, half as much in truth
    loop = {"input": "setpoint", "loop": {"law": law}, "logs": entries}
    volts = {"input": "voltage", "columns": names | {"input": "volts"}, "logs": opened}
    for file, own in zip(files, (loop, volts), strict=True):
        file.write_text(json.dumps(both | own), encoding="utf-8")
    return files


def errors(estimate, manifest):
    """Return mean absolute error in mrad and FIT in % of every log, by its name."""
    found = {}
    for log in bf.read(manifest).logs:
        parameters, own = estimate.applied(log)
        run = FreeRun.of(log, Setting(parameters=parameters, zero=own["zero"]))
        wrong = 1e3 * float(np.mean(np.abs(run.simulated - log.angle)))
        found[log.name] = wrong, run.fit
    return found


def table(rows, without):
    """Return means of the closed loop, median and worst FIT of the open one, by gain."""
    heads = "| logs | closed, mrad | closed FIT | open FIT, median | worst |"
    lines = [heads, "|---" * 5 + "|"]
    for gain in (without, *(each for each in GAINS if each != without)):
        closed, opened = (
            np.array([each for name, each in rows[way].items() if not gain or f"kp{gain}." in name])
            for way in ("closed", "open")
        )
        cells = (*closed.mean(axis=0), np.median(opened[:, 1]), opened[:, 1].min())
        what = f"kp {gain}" if gain else "all"
        lines.append(f"| {what} | {' | '.join(f'{each:.1f}' for each in cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
