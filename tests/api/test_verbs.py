"""What a verb cannot use is one typed error that names it."""

import numpy as np
import pandas as pd
import pytest

import butterfly as bf
from butterfly.identification.estimators import OutputError


def test_slips_are_one_typed_error(result, data, tmp_path):
    for slip, message in (
        (lambda: bf.identify(data, "weakform"), "did you mean"),
        (lambda: bf.identify(data, "weak-form", trms=()), "'terms'"),
        (lambda: bf.identify(data, "output-error", loss="hubber"), "loss: got 'hubber'"),
        (lambda: bf.identify(data, OutputError(), terms=()), "with an Estimator"),
        (lambda: bf.identify(data, against={"x": {"p1": 1}}), "against"),
        (lambda: bf.read(tmp_path / "nowhere"), "no such file or folder"),
        (lambda: bf.read([]), "at least one"),
        (lambda: bf.read(None), "NoneType"),
        (lambda: bf.read(""), "got empty"),
        (lambda: bf.read([3]), "int"),
        (lambda: bf.read(data, input_kind="torque"), "already read"),
        (lambda: bf.identify(data, 3), "method: got 3"),
        (lambda: bf.identify(data, holdout="log"), "holdout: got"),
        (lambda: bf.identify(data, holdout=[3]), "holdout: got"),
        (lambda: bf.identify(data, None), "method: got None"),
        (lambda: bf.identify(data, against={"x": None}), "x: got None"),
        (lambda: bf.identify(data, against={"x": {"p1": "a"}}), "p1: got a"),
        (lambda: bf.identify(data, against={"x": {"p1": -1, "p2": 0, "p3": 0}}), "p1: got -1"),
        (lambda: bf.identify(data, against=[1]), "against"),
        (lambda: bf.residual(result, "weak-form"), "with a saved result"),
        (lambda: bf.residual(result, terms=()), "with a saved result"),
        (lambda: bf.design(result, goal="2"), "goal: got 2"),
        (lambda: bf.design(result, swing=-1), "swing: got -1"),
        (lambda: bf.compare(result, logs=[]), "at least one"),
        (lambda: bf.compare(result, logs=["a"]), "log numbers"),
        (lambda: bf.compare(result, logs=0), "log numbers"),
        (lambda: bf.simulate(None), "an experiment"),
        (lambda: result.plot.time(1.5), "log: got 1.5"),
        (lambda: bf.AddedMass(mass="a"), "mass: got a"),
        (lambda: bf.Sine(omega=None, amplitude=1), "omega"),
        (lambda: bf.Log(*3 * [range(20)], added_mass=0.05), "an AddedMass"),
        (lambda: bf.Log(*3 * [range(20)], excitation=(1, 2)), "a Sine"),
        (lambda: bf.Log(np.arange(20).astype("m8[s]"), range(20), range(20)), "not numbers"),
        (lambda: bf.Log(range(20), range(20), 1j * np.arange(20)), "not numbers"),
        (lambda: bf.Log.from_frame(None), "time: got time"),
        (lambda: bf.read(data.logs[0].source, input_kind="volts"), "voltage.*torque.* or .*none"),
        (lambda: bf.validate(data, split="day"), "mass or frequency"),
        (lambda: bf.validate(data, split="log", folds="a"), "folds: got a"),
        (lambda: bf.compare(result, hand_mass="a"), "mass: got a; expected a number in kg"),
        (lambda: bf.compare(data, logs=[99]), "numbers from 0 to 8"),
        (lambda: bf.Log([0, 1], [0, 1], [0, 1]), "at least 16"),
        (lambda: bf.Log(["a"] * 20, [0] * 20, [0] * 20), "time"),
        (lambda: bf.Log(range(20), range(20), range(20), input_kind="volt"), "did you mean"),
        (lambda: bf.Log.from_frame(pd.DataFrame({"t": []}), time="t", input="u"), "input"),
    ):
        with pytest.raises(bf.InputError, match=message):
            slip()
