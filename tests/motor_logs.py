"""The motors of the library made again from their logs, and compared with their files.

``python -m tests.motor_logs [NAMES] [--logs FOLDER]`` reads the logs of each motor in FOLDER/NAME,
or else takes them from the repository that its file names, at its commit, with git.
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


def fetched(name, folder):
    """Return the folder of a motor's logs: in a folder of such, or fetched from their source."""
    if folder is not None:
        return folder / name
    source, target = motor_of(name).source, FETCHED / name
    if not target.is_dir():
        _git("init", "--quiet", str(target))
        _git("-C", str(target), "fetch", "--quiet", "--depth=1", source.repository, source.commit)
        _git("-C", str(target), "checkout", "--quiet", source.commit, "--", source.folder)
    return target / source.folder


def _git(*words):
    subprocess.run(["git", *words], check=True)  # noqa: S603, S607 - the user's git


def differences(name, logs):
    """Return where a motor's file differs from what its logs say now, in sentences."""
    motor = motor_of(name)
    data = Manifest.model_validate({**motor.made.manifest, "root": str(logs.absolute())})
    missing = [entry.file for entry in data.logs if not (logs / entry.file).is_file()]
    if missing:
        return [f"{name}: no {logs / missing[0]}"]
    estimate = bf.identify(bf.read(written(data, FETCHED / f"{name}.yaml"))).estimate
    told = [] if estimate.level is motor.level else [f"verdict {estimate.level.verdict}"]
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
    return [f"{name}: {text}" for text in told]


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
        parts = differences(name, fetched(name, given.logs))
        print("\n".join(parts) if parts else f"{name}: as in its file", flush=True)
        told += parts
    sys.exit(bool(told))


if __name__ == "__main__":
    main()
