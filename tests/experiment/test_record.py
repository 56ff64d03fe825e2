"""Records come back from JSON as they went."""

import math
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from butterfly.experiment.estimate_record import EstimateRecord, ParameterRecord
from butterfly.experiment.orbit_record import CrossRecord, OrbitRecord
from butterfly.experiment.record import PlannedRun, RunRecord, SweepRecord
from butterfly.identification.diagnostics.findings import Ending, Finding, FindingKind
from butterfly.identification.free_run import FitSummary
from butterfly.verdict import Level

PARAMETER = ParameterRecord(
    parameter="p3", value=0.05, standard_error=1e-4, lower=0.0498, upper=0.0502, true=0.04
)
ON_BOUND = Finding(kind=FindingKind.ON_BOUND, parameters=("p2",), number=1.5, severity=Level.CARE)
ESTIMATE = EstimateRecord(
    estimator="output-error(drag)",
    ending=Ending.STOPPED,
    parameters=(PARAMETER,),
    condition=3.0,
    findings=(ON_BOUND,),
    fit=FitSummary(99.0, -math.inf, -3e4),
)
ORBIT = OrbitRecord(
    target_rad=1.0,
    amplitudes_rad=(None, 0.99),
    ending="two rounds were made",
    absolute=False,
    parameters=(PARAMETER,),
    free_run_rms_rad={"generic": 0.1, "re-calibrated": 0.01},
    cross_orbit=CrossRecord(amplitudes_rad=(1.0,), rms_rad=((0.1,),)),
)

json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=5,
)


@given(st.dictionaries(st.text(), json_values), st.integers(0, 2**63 - 1), st.text())
def test_a_run_comes_back_from_json(overrides, seed, error):
    record = RunRecord(
        key="a",
        status="ok",
        error=error,
        seed=seed,
        overrides=overrides,
        estimates=(ESTIMATE,),
        orbit=ORBIT,
        seconds={"total": 1.25},
    )
    assert RunRecord.from_json(record.to_json()) == record


def test_a_sweep_comes_back_from_json():
    run = PlannedRun(number=0, key="a", repetition=1, seed=2**63 - 1, overrides={"x.y": [1, None]})
    about = {"name": "s", "description": "", "seed": 0, "worst": 3, "versions": {"numpy": "2"}}
    sweep = SweepRecord(**about, fields=("x.y",), runs=(run,))
    assert SweepRecord.from_json(sweep.to_json()) == sweep


def test_a_value_that_is_no_number_comes_back_as_none():
    odd = replace(PARAMETER, value=math.nan)
    record = RunRecord(status="ok", seed=0, estimates=(replace(ESTIMATE, parameters=(odd,)),))
    (back,) = RunRecord.from_json(record.to_json()).estimates
    assert np.isnan(back.parameters[0].value)


def test_another_schema_is_not_read():
    assert RunRecord.from_json(RunRecord(schema=2, status="ok", seed=0).to_json()) is None
    assert RunRecord.from_json(RunRecord(status="ok", seed=0).to_json()) is not None


def test_no_digit_of_a_record_may_change():
    text = RunRecord(key="a", status="ok", seed=0, estimates=(ESTIMATE,)).to_json()
    assert RunRecord.from_json(text.replace("0.0498", "0.0497")) is None
    assert RunRecord.from_json(text.replace('"seed": 0', '"seed": 1')) is None
    assert RunRecord.from_json(text) is not None


def test_deviation_is_relative_to_the_truth_where_there_is_one():
    assert PARAMETER.deviation == 0.25
    assert replace(PARAMETER, true=0.0).deviation is None
    assert replace(PARAMETER, true=None).deviation is None


def test_an_estimate_that_did_not_converge_is_counted():
    record = RunRecord(status="ok", seed=0, estimates=(ESTIMATE, replace(ESTIMATE, parameters=())))
    assert record.unconverged == 1
