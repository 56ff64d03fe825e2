"""What is recorded: each case by its name, as a function without arguments."""

import os
import subprocess
import sys
import tempfile
from functools import cache, partial
from math import pi
from pathlib import Path

import numpy as np

from tests.record import program

SHARED = program.CHECKOUT.parent / "shared/data"
METHODS = ("auto", "harmonic-balance", "output-error", "weak-form", "linear", "thesis")
BOTH = ("auto", "output-error")
SEED = 1
QUICK_START = "experiments/quickstart.yaml"
ORBIT = "experiments/orbit-recalibration.yaml"

PENDULUM = {
    "input_kind": "torque",
    "columns": {"time": "time", "input": "torque", "angle": "position"},
}
THREE = ["ddp.csv", "direct_collocation.csv", "ilqr.csv"]
OTHERS = ["energy_shaping.csv", "pd_system_identification.csv", "energy_shaping_1kg.csv"]
DRIVE = {
    "input_kind": "voltage",
    "columns": {"time": "timestep (8Hz)", "input": "voltage", "angle": "position"},
    "units": {"time": 1 / 8000, "angle": "turns"},
    "gravity": 0,
    "repair": ["non_finite", "backward"],
}


def prepare(folder, part):
    """Write into a folder what the cases read, as far as this machine has it."""
    program.simulate(program.CHECKOUT / QUICK_START, folder / "quickstart")
    if part == "quick":
        return
    if _strangers().is_dir():
        write_servo(_strangers() / "xl330", folder / "xl330")
    make = SHARED / "cases/make.py"
    if make.is_file():
        subprocess.run([sys.executable, make, folder / "made"], check=True)  # noqa: S603


def cases(folder, part, robots):
    """Return the cases by name; what stands before a name's last stroke is best run together."""
    found = _quick(folder) if part == "quick" else _full(folder)
    for number in range(1 if part == "quick" else robots):
        for family, methods in program.FAMILIES.items():
            of_robot = partial(_of_family, family, number)
            found |= {
                f"family/{family}{number}/{each}": partial(of_robot, each) for each in methods
            }
        for kind in program.KINDS:
            of_kind = partial(_of_kind, folder, kind, number)
            found |= {f"kind/{kind}-{number}/{each}": partial(of_kind, each) for each in BOTH}
    return found


def places(folder):
    """Return where all this lies, of which a record says nothing."""
    named = [Path(folder), _real(), _strangers(), SHARED, program.CHECKOUT]
    return [str(each) for path in named for each in (path, path.resolve())]


def _quick(folder):
    found = {"quickstart/logs": partial(_logs, folder / "quickstart")}
    for method in BOTH:
        found[f"quickstart/{method}"] = partial(_of_folder, folder / "quickstart", method)
    if _real().is_dir():
        found["real/12 logs/auto"] = partial(_of_real, "auto", 12)
        found["real/6 logs/output-error"] = partial(_of_real, "output-error", 6)
    return found


def _full(folder):
    start = folder / "quickstart"
    found = {
        "orbit": partial(program.orbit, ORBIT, folder / "orbit"),
        "quickstart/logs": partial(_logs, start),
        "quickstart/predict": partial(
            _answered, "predict", start, ("data", "found"), draws=50, seed=SEED
        ),
        "quickstart/draws": partial(_answered, "draws", start, ["found"], 40, SEED),
        "quickstart/changed": partial(_answered, "changed", start, ("found", "other")),
        "quickstart/held out": partial(_of_folder, start, "auto", holdout=("*120g*",)),
    }
    found |= {f"quickstart/{each}": partial(_of_folder, start, each) for each in METHODS}
    if _real().is_dir():
        found |= {f"real/{each}": partial(_of_real, each) for each in METHODS}
        found["real/held out"] = partial(_of_real, "auto", holdout=("*154*",))
        found["real/validate"] = partial(_answered, "validate", _real(), ["data"])
        found["real/design"] = partial(_answered, "design", _real(), ["found"])
        found["real/compare"] = partial(_answered, "compare", _real(), ["found"], logs=[0, 20, 40])
    if _strangers().is_dir():
        found |= _of_strangers(folder)
    for made in sorted((folder / "made").glob("*/manifest.yaml")):
        for method in BOTH:
            found[f"made/{made.parent.name}/{method}"] = partial(_of_folder, made.parent, method)
    return found


def _of_strangers(folder):
    """Describe the logs of others as docs/others-logs.md and their READMEs do."""
    known = {"p4": 1}
    drawings = {"p3": (2.98, 0.03), "p4": (1, 0.2)}
    three = partial(_of_files, "dfki", THREE, PENDULUM)
    runs = {
        **{f"dfki/{each}": partial(three, each, known) for each in ("auto", "weak-form")},
        "dfki/no delay": partial(three, "auto", {"p4": 1, "delay": 0}),
        "dfki/drawings": partial(three, "auto", drawings),
        "dfki/hand mass": partial(three, "auto", {"p4": 1, "hand_mass": (0.6, 0.01)}),
        "dfki/held out": partial(three, "auto", known, holdout=("ilqr.csv",)),
        "dfki/no gain": partial(three, "auto", {}),
        "dfki/others": partial(_of_files, "dfki", OTHERS, PENDULUM, "auto", known),
    }
    steps = [f"step{k}.csv" for k in range(1, 6)]
    for method in ("weak-form", "linear"):
        runs[f"odrive/{method}"] = partial(_of_files, "odrive", steps, DRIVE, method, {"p4": 1})
    for method in ("auto", "weak-form"):
        runs[f"xl330/{method}"] = partial(_of_folder, folder / "xl330", method)
    return runs


def _of_real(method, count=None, **options):
    return program.identification(_found(_real(), method, count, **options), _data(_real(), count))


def _data(folder, count=None):
    return program.real_logs(folder, count) if folder == _real() else program.read(folder)


@cache
def _found(folder, method="auto", count=None, **options):
    return program.identify(_data(folder, count), method, **options)


def _answered(verb, folder, given, *more, **options):
    """Ask for more of data, of what was found, or of both; two methods where ``given`` asks so."""
    made = {"data": _data, "found": _found, "other": partial(_found, method="output-error")}
    return program.answered(verb, *(made[each](folder) for each in given), *more, **options)


def _of_folder(folder, method, **options):
    data = program.read(folder)
    return program.identification(program.identify(data, method, **options), data)


def _logs(folder):
    return program.logs(program.read(folder))


def _of_files(whose, files, told, method, known, **options):
    data = program.read([_strangers() / whose / file for file in files], **told, known=known)
    return program.identification(program.identify(data, method, **options), data)


def _of_family(family, number, method):
    data = program.robot(family, number, SEED)
    return program.identification(program.identify_robot(data, method), data)


def _of_kind(folder, kind, number, method):
    with tempfile.TemporaryDirectory(dir=folder) as written:
        program.write_kind(kind, number, SEED, Path(written))
        return _of_folder(written, method)


def _real():
    return Path(os.environ.get("BUTTERFLY_LOGS") or SHARED / "butterfly_logs")


def _strangers():
    return Path(os.environ.get("BUTTERFLY_STRANGERS") or SHARED / "strangers")


def write_servo(source, folder):
    """Write the voltage that the servo's own law makes of its goal, of the runs of a pendulum."""
    folder.mkdir()
    files = [f"sin_{name}_kp{gain}" for name in ("sin", "time_square") for gain in (100, 200, 800)]
    for file in files:
        log = np.genfromtxt(source / f"{file}.csv", delimiter=",", names=True)
        gain = float(file.rpartition("kp")[2]) * 4096 / (2 * pi) / (256 * 885)
        duty = np.clip(gain * (log["goal_rad"] - log["angle_rad"]), -1.0, 1.0)
        voltage = log["supply_V"] * duty * log["torque_enabled"]
        rows = np.column_stack([log["time_s"], voltage, log["angle_rad"]])
        names = "time,input,angle"
        np.savetxt(folder / f"{file}.csv", rows, "%.17g", ",", header=names, comments="")
    listed = "".join(f"  - {{file: {file}.csv}}\n" for file in files)
    told = f"name: xl330\ninput: voltage\nknown: {{p3: {0.49 * 9.81 * 0.1:.6g}}}\nlogs:\n{listed}"
    (folder / "manifest.yaml").write_text(told, encoding="utf-8")
