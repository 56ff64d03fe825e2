"""The motors of the library made again from their logs, and compared with their files.

``python -m tests.motor_logs [NAMES] [--logs FOLDER]`` takes the logs of each motor of a type from
the repository that its file names, at its commit, with git; or reads them in FOLDER/NAME, and of
several motors in FOLDER/NAME/1, FOLDER/NAME/2, ...
"""

import argparse
import subprocess
import sys
from pathlib import Path

import butterfly as bf
from butterfly.logs.manifest import Manifest, manifest_text
from butterfly.logs.motors import motor_names, motor_of
from butterfly.twin.motor_file import measured_values

FETCHED = Path(__file__).parents[1] / "build/motors"
NEAR = 0.02
"""Share of the distance to a limit within which values and limits are the same."""


def fetched(source):
    """Return the folder of a motor's logs, fetched from their source."""
    target = FETCHED / f"{Path(source.repository).name}-{source.commit[:12]}"
    if not (target / source.folder).is_dir():
        _git("init", "--quiet", str(target))
        _git("-C", str(target), "fetch", "--quiet", "--depth=1", source.repository, source.commit)
        _git("-C", str(target), "checkout", "--quiet", source.commit, "--", source.folder)
    return target / source.folder


def _git(*words):
    subprocess.run(["git", *words], check=True)  # noqa: S603, S607 - the user's git


def differences(name, folder):
    """Return where a type's file differs from what the logs of its motors say now, in sentences."""
    motors = motor_of(name).motors
    told = []
    for number, motor in enumerate(motors, 1):
        place = Path(str(number)) if len(motors) > 1 else Path()
        logs = fetched(motor.source) if folder is None else folder / name / place
        which = f"{name}, motor {number}" if len(motors) > 1 else name
        told += [f"{which}: {text}" for text in _differences(motor, logs)]
    return told


def _differences(motor, logs):
    """Return where a motor's part of a file differs from what its logs say now."""
    data = Manifest.model_validate({**motor.made.manifest, "root": str(logs.absolute())})
    missing = [entry.file for entry in data.logs if not (logs / entry.file).is_file()]
    if missing:
        return [f"no {logs / missing[0]}"]
    estimate = bf.identify(bf.read(written(data, FETCHED / f"{data.name}.yaml"))).estimate
    told = [] if estimate.level.verdict == motor.verdict else [f"verdict {estimate.level.verdict}"]
    for place, now in zip(("known", "rig"), measured_values(estimate), strict=True):
        before = getattr(motor, place)
        if now.keys() != before.keys():
            told.append(f"{place}: {', '.join(now)}; in the file {', '.join(before)}")
        for key in now.keys() & before.keys():
            was = before[key]
            parts = ("value", "lower", "upper")
            far = max(abs(now[key][part] - getattr(was, part)) for part in parts)
            if far > NEAR * was.farther:
                told.append(f"{place}.{key}: {now[key]}; in the file {was}")
    return told


def written(manifest, path):
    """Return the path of a manifest that was written to it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(manifest_text(manifest), encoding="utf-8")
    return path


def main():
    """Compare the motors that are named, or all; end with 1 if any differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAMES")
    parser.add_argument("--logs", type=Path, default=None)
    given = parser.parse_args()
    told = []
    for name in given.names or motor_names():
        parts = differences(name, given.logs)
        print("\n".join(parts) if parts else f"{name}: as in its file", flush=True)
        told += parts
    sys.exit(bool(told))


if __name__ == "__main__":
    main()
