"""Records come back from JSON as they went."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from butterfly.experiment.record import (
    EstimateRecord,
    OrbitRecord,
    RunRecord,
    SweepRecord,
    SweepRun,
)
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FitSummary
from butterfly.identification.trust import Ending, Finding, FindingKind
from butterfly.model.parameters import AddedMass

ON_BOUND = Finding(FindingKind.ON_BOUND, ("p2",), number=1.5)
ABOUT = {"condition": 3.0, "on_bound": ("p2",), "ending": Ending.STOPPED, "findings": (ON_BOUND,)}
LIMITS = {"lower": np.array([0.0, 0.0498]), "upper": np.array([0.0, 0.0502])}
VALUES = {"values": np.array([0.0, 0.05]), "covariance": np.diag([0.0, 1e-8])}
VALUES |= {"left_out": {AddedMass(mass=0.1, arm=0.1): np.array([0.0, 0.06])}}
FOUND = Estimate(method="output error", names=("p2", "p3"), **VALUES, **LIMITS, **ABOUT)
FITTED = {"truth": {"p2": 0.0, "p3": 0.04}, "fit": FitSummary(99.0, -math.inf, -3e4)}
ESTIMATE = EstimateRecord(estimator="output-error(drag)", estimate=FOUND, **FITTED)
ORBIT = OrbitRecord(
    target_rad=1.0,
    amplitudes_rad=(None, 0.99),
    ending="two rounds were made",
    reached=False,
    absolute=False,
    free_run_rms_rad={"generic": 0.1, "re-calibrated": 0.01},
    cross_orbit={"amplitudes_rad": (1.0,), "rms_rad": ((0.1,),)},
)

numbers = st.integers() | st.floats(allow_nan=False, allow_infinity=False)
json_values = st.recursive(
    st.none() | st.booleans() | numbers | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=5,
)


@settings(max_examples=20)
@given(st.dictionaries(st.text(), json_values), st.integers(0, 2**63 - 1), st.text())
def test_a_run_comes_back_from_json(overrides, seed, error):
    asked = {"key": "a", "seed": seed, "overrides": overrides}
    found = {"estimates": (ESTIMATE,), "orbit": ORBIT, "seconds": {"total": 1.25}}
    record = RunRecord(status="ok", error=error, **asked, **found)
    back = RunRecord.from_json(record.to_json())
    assert back is not None
    assert replace(back, estimates=()) == replace(record, estimates=())
    assert back.estimates[0].fit == ESTIMATE.fit
    assert back.estimates[0].parameters == ESTIMATE.parameters
    assert back.estimates[0].estimate.findings == (ON_BOUND,)
    assert back.to_json() == record.to_json()


def test_a_sweep_comes_back_from_json():
    run = SweepRun(number=0, key="a", repetition=1, seed=2**63 - 1, overrides={"x.y": [1, None]})
    about = {"name": "s", "description": "", "seed": 0, "worst": 3, "versions": {"numpy": "2"}}
    sweep = SweepRecord(**about, fields=("x.y",), runs=(run,))
    assert SweepRecord.from_json(sweep.to_json()) == sweep


def test_a_value_that_is_no_number_comes_back_as_none():
    odd = replace(FOUND, values=np.array([math.nan, 0.05]))
    record = RunRecord(status="ok", seed=0, estimates=(replace(ESTIMATE, estimate=odd),))
    (back,) = RunRecord.from_json(record.to_json()).estimates
    assert np.isnan(back.parameters[0].value)


def test_another_schema_is_not_read_and_no_digit_of_a_record_may_change():
    assert RunRecord.from_json(RunRecord(schema=2, status="ok", seed=0).to_json()) is None
    text = RunRecord(key="a", status="ok", seed=0, estimates=(ESTIMATE,)).to_json()
    assert RunRecord.from_json(text.replace("0.0498", "0.0497")) is None
    assert RunRecord.from_json(text.replace('"seed": 0', '"seed": 1')) is None
    assert RunRecord.from_json(text) is not None


def test_deviation_is_relative_to_the_truth_where_there_is_one():
    at_zero, known = ESTIMATE.parameters
    assert known.deviation == pytest.approx(0.25)
    assert (at_zero.true, at_zero.deviation) == (0.0, None)
    assert replace(known, true=None).deviation is None


def test_an_estimate_that_did_not_converge_is_counted():
    refused = EstimateRecord(estimator="thesis", error="too few logs")
    record = RunRecord(status="ok", seed=0, estimates=(ESTIMATE, refused))
    assert record.unconverged == 1
    assert refused.ending is Ending.REFUSED
    assert record.reason == "thesis: too few logs"
