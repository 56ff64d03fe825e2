"""Each refusal in docs/refusals.md: what provokes it, how it begins, and that its remedy works."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from butterfly.cli.output import ExitCode
from butterfly.logs.csv import write_csv
from butterfly.logs.log import Sine
from butterfly.logs.mat import write_mat
from butterfly.model.linear import quasi_linear_response
from tests.conftest import MASSES
from tests.identification.simulated import ROBOT, STEP, simulated, wild
from tests.logs.written import mat73

PAGE = (Path(__file__).parents[1] / "docs/refusals.md").read_text(encoding="utf-8")
_CELLS = [line[2:].split(" | ", 2) for line in PAGE.splitlines()]
ROWS = {row[0]: row[1:] for row in _CELLS if len(row) == 3 and row[0] != "situation"}
"""What the page says of each situation: how the refusal begins, and its remedy."""

OF_MATLAB = "a .mat file of v7.3 without h5py"

OPTIONS = {
    "WEAK": "--method weak-form --terms=",
    "BALANCE": "--method harmonic-balance --terms=",
    "GAIN": "--known p4=0.5",
}
"""What words of the commands below stand for."""
ARM = "arm: 0.104"

BARE, ONE = "file: bare.csv", "file: 1.csv, added_mass: 0.05"
DECAYS = [f"file: decay{k}.csv, added_mass: {mass.mass}" for k, mass in enumerate(MASSES)]
FREE = [f"file: free{k}.csv, added_mass: {mass.mass}" for k, mass in enumerate(MASSES)]
SWINGS = {3.0: 0.6, 4.4: 0.3, 7.5: 0.15}
AMPLITUDES = {
    omega: swing / abs(complex(quasi_linear_response(ROBOT, omega, swing)))
    for omega, swing in SWINGS.items()
}
SINES = [
    f"file: sine{omega}.csv, omega: {omega}, amplitude: {AMPLITUDES[omega]:.9g}" for omega in SWINGS
]

MANIFESTS = {
    "bare": ([BARE],),
    "bare-known": ([BARE], "known: {p4: 0.5}"),
    "volts": ([BARE], "input: voltage"),
    "slide": (["file: slide.csv"], "input: voltage", "joint: slide"),
    "one": ([ONE], ARM),
    "two": ([BARE, ONE], ARM),
    "two-known": ([BARE, ONE], ARM, "known: {p4: 0.5}"),
    "no-arm": ([BARE, ONE],),
    "decays": (DECAYS, ARM),
    "driven": ([*DECAYS, BARE], ARM),
    "free": (FREE, ARM),
    "free-none": (FREE, ARM, "input: none"),
    "free-and-driven": ([f"{each}, input: none" for each in FREE] + [BARE], ARM),
    "speed": (["file: speed.csv"],),
    "sine": (SINES[:1],),
    "sines": (SINES,),
    "unsaid-sines": ([sine.split(",")[0] for sine in SINES],),
    "rest": ([BARE, "file: still.csv"],),
    "motion": ([BARE],),
    "degrees": (["file: degrees.csv"],),
    "ms": (["file: ms.csv"],),
    "restarts": (["file: restarts.csv"], "split: restarts"),
    "mixed-up": ([BARE], "colums: {time: t}"),
}
"""Logs and further keys of each manifest."""


def _of(command, ending):
    """Words of a command about each file that is named, without its ending, before options."""
    return lambda *asked: tuple(
        f"{command} {file}.{ending} {' '.join(options)}" for file, *options in map(str.split, asked)
    )


_identify, _inspect = _of("identify", "yaml"), _of("inspect", "csv")
CASES = {
    "nothing fixes the scale": _identify(
        "bare WEAK",
        "two WEAK",
        "bare WEAK GAIN",
        "bare WEAK --known p3=0.04",
        "bare WEAK --known p1=0.003",
        "volts WEAK --known resistance=2,torque_constant=1",
    ),
    "one added mass only": _identify("one WEAK", "two WEAK", "one WEAK GAIN"),
    "a slide whose motor has no gear ratio": _identify(
        "slide WEAK --known resistance=2,torque_constant=1",
        "slide WEAK --known resistance=2,torque_constant=1,gear_ratio=1",
    ),
    "no input": _identify("decays WEAK", "driven WEAK", "decays WEAK --known p4=0.5,delay=0"),
    "no input column": (
        *_identify("free WEAK", "free-none WEAK", "free-and-driven WEAK"),
        "inspect free0.csv --input none",
    ),
    "a velocity without an angle": _identify(
        "speed WEAK GAIN",
        "speed WEAK GAIN --gravity 0",
        "speed WEAK GAIN --joint slide",
        "speed WEAK --known p4=0.5,p3=0",
    ),
    "no sines, for a method that needs them": _identify(
        "unsaid-sines BALANCE GAIN", "sines BALANCE GAIN", "unsaid-sines WEAK GAIN"
    ),
    "too few sines": _identify("sine BALANCE GAIN", "sines BALANCE GAIN"),
    "a mass without an arm": _identify("no-arm WEAK", "two WEAK"),
    "file names with masses, but no arm": (
        "identify folder BALANCE GAIN",
        "identify folder BALANCE GAIN --input torque --arm 0.104",
        "manifest folder --input torque --arm 0.104",
        "identify folder BALANCE GAIN",
    ),
    "a wrapped angle": _inspect("wrapped", "wrapped --repair unwrap"),
    "a wrapped counter": _inspect("counter", "counter --units angle=counts/400 --repair unwrap"),
    "brackets without a unit": _inspect("ticks", "ticks --units angle=counts/4096"),
    "two different units": _inspect(
        "deg --input torque --units angle=rad",
        "deg --input torque",
        "deg --input torque --units angle=1",
    ),
    "a unit that does not fit the input": _inspect("deg", "deg --input torque"),
    "a header of another length": _inspect("wide", "wide --columns time=0,input=1,angle=2"),
    "thousands separators in timestamps": _inspect("thousands", "0"),
    "degrees read as rad": _identify("degrees WEAK GAIN", "degrees WEAK GAIN --units angle=deg"),
    "milliseconds read as s": _identify("ms WEAK GAIN", "ms WEAK GAIN --units time=ms"),
    "a clock that restarts": (
        *_inspect("restarts", "restarts --restarts"),
        "inspect restarts.yaml",
        "inspect restarts.csv --repair backward",
    ),
    "missing samples": _inspect("nan", "nan --repair non_finite"),
    "a joint that does not move": _identify("rest WEAK GAIN", "motion WEAK GAIN"),
    "columns of other names": _inspect("named", "named --columns time=t_s,input=torque,angle=pos"),
    "an unknown unit": _inspect(
        "0 --units angle=furlong", "0 --units angle=mrad", "0 --units angle=201.168"
    ),
    "an unknown parameter": _identify("bare WEAK --known p44=0.5", "bare WEAK GAIN"),
    "an unknown key": _identify("mixed-up WEAK", "named WEAK GAIN"),
    "no mass can be held out": (
        "validate bare-known.yaml --split mass --method weak-form --terms=",
        "validate bare-known.yaml --split time --method weak-form --terms=",
    ),
    "only one mass would remain": (
        "validate two.yaml --split mass --method weak-form --terms=",
        "validate two.yaml --split time --method weak-form --terms=",
        "validate two-known.yaml --split mass --method weak-form --terms=",
    ),
    "all logs held out": _identify("two WEAK GAIN --holdout *", "two WEAK GAIN --holdout 1.csv"),
    "a known value the method cannot use": _identify(
        "bare WEAK --known p4=0.5,tilt=0.01",
        "bare --method output-error --terms= --known p4=0.5,tilt=0.01",
    ),
    "two exact values that differ": _identify(
        "volts WEAK --known resistance=2,torque_constant=1,p4=0.4",
        "volts WEAK --known resistance=2,torque_constant=1,p4=0.5",
        "volts WEAK --known resistance=2,torque_constant=1,p4=0.4+-0.1",
    ),
    "a known value that contradicts the logs": _identify(
        "bare WEAK --known p4=0.5,p1=0.3", "bare WEAK --known p4=0.5,p1=0.003"
    ),
    "given parameters without p4": (
        "predict bare.yaml --with p1=0.003,p2=0.001,p3=0.04,coulomb=0.0008",
        "predict bare.yaml --with p1=0.003,p2=0.001,p3=0.04,coulomb=0.0008,p4=0.5",
    ),
    "a part outside the log": _inspect("0 --from 20", "0 --from 2"),
    "a log too short for the weak form": (
        "identify 0.csv --input torque WEAK GAIN --from 11.95",
        "identify 0.csv --input torque WEAK GAIN --from 9",
    ),
}
"""A command that is refused in a situation of the page, and commands that are not."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Logs with all the slips, and manifests of them."""
    folder = tmp_path_factory.mktemp("refused")
    logs = wild(ROBOT, MASSES[:2], duration=12.0)
    coarse = [log.take(np.arange(0, 3600, 2)) for log in logs]
    (folder / "folder").mkdir()
    for path, log in {"0": logs[0], "bare": coarse[0], "1": coarse[1]}.items():
        write_csv(log, folder / f"{path}.csv")
    for number, mass in enumerate(MASSES):
        decay = simulated(ROBOT, mass, np.zeros_like, 6.0, start=0.6, step=2 * STEP)
        write_csv(decay, folder / f"decay{number}.csv")
        _write_table(folder / f"free{number}.csv", "time,angle", (decay.time, decay.angle))
    for omega, amplitude in AMPLITUDES.items():
        sine = Sine(omega=omega, amplitude=amplitude)
        log = simulated(ROBOT, MASSES[0], sine.sample, 20.0, sine=sine, step=2 * STEP)
        write_csv(log, folder / f"sine{omega}.csv")
        name = f"Data_0__{omega}__0".replace(".", "_") + f"{amplitude:.9f}"[2:]
        write_csv(log, folder / f"folder/{name}.csv")
    free = replace(ROBOT, p3=0.0)
    sliding = simulated(free, MASSES[0], lambda t: 0.02 * np.sin(3 * t), 12.0, step=2 * STEP)
    write_csv(sliding, folder / "slide.csv")
    turned = sliding.time, sliding.input, np.gradient(sliding.angle, sliding.time)
    _write_table(folder / "speed.csv", "time,input,velocity", turned)
    _write_slips(folder, logs[0])
    turned = coarse[0].time, coarse[0].input, np.rad2deg(coarse[0].angle)
    _write_table(folder / "degrees.csv", "time,input,angle", turned)
    for name, (entries, *keys) in MANIFESTS.items():
        _write_manifest(folder / f"{name}.yaml", entries, keys)
    named = "columns: {time: t_s, input: torque, angle: pos}"
    _write_manifest(folder / "named.yaml", ["file: named.csv"], [named])
    return folder


def _write_slips(folder, log):
    time, u, angle = log.time, log.input, log.angle
    turning = 6 * time + 0.3 * np.sin(3 * time)
    holed = np.where(np.arange(time.size) == 7, np.nan, angle)
    tables = {
        "ms": (1e3 * time, u, angle),
        "wrapped": (time, u, (turning + np.pi) % (2 * np.pi) - np.pi),
        "counter": (time, u, 400 * (turning / (2 * np.pi) % 1)),
        "still": (time, u, 0 * angle),
        "restarts": (np.tile(time, 2), np.tile(u, 2), np.tile(angle, 2)),
        "nan": (time, u, holed),
    }
    for name, columns in tables.items():
        _write_table(folder / f"{name}.csv", "time,input,angle", columns)
    _write_table(folder / "named.csv", "t_s,torque,pos", (time, u, angle))
    _write_table(folder / "ticks.csv", "time,input,angle [ticks]", (time, u, 650 * angle))
    _write_table(folder / "deg.csv", "time,input (Nm),angle [deg]", (time, u, np.rad2deg(angle)))
    _write_table(folder / "wide.csv", "time,input,angle", (time, u, angle, u + 0.5))
    stamps = np.arange(1.0, time.size + 1)
    stamps[stamps > 999] /= 1000
    _write_table(folder / "thousands.csv", "time,input,angle", (stamps, u, angle))


def _write_table(path, header, columns):
    np.savetxt(path, np.column_stack(columns), "%.9g", ",", header=header, comments="")


def _write_manifest(path, entries, keys):
    kind = [] if any(key.startswith("input") for key in keys) else ["input: torque"]
    lines = [f"name: {path.stem}", *keys, *kind, "intersample: first_order_hold", "logs:"]
    path.write_text("\n".join([*lines, *(f"  - {{{entry}}}" for entry in entries)]) + "\n")


def _spelt(command):
    return " ".join(OPTIONS.get(word, word) for word in command.split()).split()


@pytest.fixture(scope="module")
def answers():
    return {}


@pytest.fixture
def run(folder, butterfly, answers, monkeypatch):
    """Run a command where the logs are, once; returns its exit code and all that it printed."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "1000")

    def run(command):
        if command not in answers or " folder " in command:  # of which a manifest is made
            code, out, err = butterfly(*_spelt(command))
            answers[command] = code, err + out
        return answers[command]

    return run


@pytest.mark.parametrize("situation", CASES)
def test_it_is_refused_in_these_words_and_the_remedy_works(situation, run):
    refused, *remedies = CASES[situation]
    code, printed = run(refused)
    assert code in {ExitCode.BAD_INPUT, ExitCode.NOT_TO_BE_USED}
    assert ROWS[situation][0].strip("`") in printed
    for remedy in remedies:
        assert run(remedy)[0] == ExitCode.DONE, remedy


def test_without_h5py_files_of_v7_3_are_refused_and_with_it_read(tmp_path, monkeypatch, butterfly):
    path, older = tmp_path / "v73.mat", tmp_path / "v7.mat"
    log = simulated(ROBOT, MASSES[0], lambda t: 0.02 * np.sin(3 * t), 3.0)
    with mat73(path) as file:
        file["D"] = [log.time, log.input, log.angle]
    write_mat(log, older)
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "h5py", None)
        code, _, said = butterfly("inspect", path)
        assert code == ExitCode.BAD_INPUT
        assert ROWS[OF_MATLAB][0].strip("`") in said
        assert butterfly("inspect", older)[0] == ExitCode.DONE
    assert butterfly("inspect", path)[0] == ExitCode.DONE


def test_the_page_has_a_row_of_each_and_names_no_option_that_was_not_tried():
    assert ROWS.keys() == CASES.keys() | {OF_MATLAB}
    for situation, (_, *remedies) in CASES.items():
        tried = {word for remedy in remedies for word in _spelt(remedy)}
        assert {*re.findall(r"--[a-z]+", ROWS[situation][1])} <= tried, situation
