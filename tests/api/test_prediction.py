"""What is predicted, and drawn, from Python."""

from dataclasses import replace

import numpy as np
import pytest

import butterfly as bf
from butterfly.api.prediction import BAND_DRAWS
from butterfly.identification.data import DataSet
from butterfly.model.parameters import LumpedParameters
from butterfly.model.prior import Known
from butterfly.verdict import CONFIDENCE


def test_of_the_draws_of_a_band_five_are_expected_beyond_either_edge():
    assert pytest.approx(5.0) == BAND_DRAWS * (1 - CONFIDENCE) / 2


def test_an_experiment_is_predicted_by_its_inputs_alone(quick, result):
    plans = (quick, {"bands": False}), (bf.read_experiment(quick), {"draws": 40})
    for plan, options in plans:
        predicted = bf.predict(plan, result, **options)
        assert "no measurement to compare" in predicted.summary[0]
        assert predicted.verdict == [*predicted.summary[1:3]]
        assert not any("FIT" in name or "inside" in name for name in predicted.rows()[0])
    found = bf.simulate(quick)
    run, log = predicted.predictions[3].run, found.logs[3]
    np.testing.assert_array_equal(run.log.input, log.input)
    apart = np.sqrt(np.mean((run.simulated - log.angle) ** 2)) / np.std(log.angle)
    assert apart < 0.1
    assert predicted.page().sections[0].title == "In time"


def test_a_mass_beyond_those_seen_is_said_to_be(data, few, predicted):
    far = replace(data.logs[-1], added_mass=bf.AddedMass(mass=0.3, arm=0.104))
    said = bf.predict(far, few, draws=40).summary
    assert any("300 g at 104 mm: extrapolation beyond the added masses" in each for each in said)
    assert not any("beyond" in each for each in predicted.summary)


def test_an_estimate_that_left_no_mass_out_says_so(data):
    rest = bf.read([log for log in data.logs if log.added_mass.mass > 0])
    found = bf.identify(rest, terms=())
    assert "may be too narrow for another mass" in str(bf.predict(rest.logs[0], found, draws=40))


def test_slips_are_one_typed_error(data, result, predicted, by_thesis, tmp_path):
    predicted.save(tmp_path / "p.json")
    for slip, message in (
        (lambda: bf.predict(data, predicted), "result: got Predicted"),
        (lambda: bf.predict(data, tmp_path / "p.json"), "result: got Predicted"),
        (lambda: bf.predict(data, data), "result: got DataSet"),
        (lambda: bf.predict(tmp_path / "nowhere", result), "no such file"),
        (lambda: bf.predict("", result), "got empty"),
        (lambda: bf.predict("nowhere", "nothing.json", draws=5), "at least 40"),  # before it reads
        (lambda: bf.draws(result, seed=-1), "seed: got -1"),
        (lambda: bf.identify(data, metod="linear"), "metod: got an unknown.*expected 'method'"),
        (lambda: bf.predict(replace(data.logs[0], input_kind="torque"), result), "input: got torq"),
    ):
        with pytest.raises(bf.InputError, match=message):
            slip()
    with pytest.raises(bf.IdentifiabilityError, match="no covariance"):
        bf.draws(by_thesis)


@pytest.fixture
def own(result):
    return {name: getattr(result.parameters, name) for name in ("p1", "p2", "p3", "p4", "coulomb")}


def test_given_parameters_are_judged_by_how_they_move(data, own):
    found = bf.predict(data, own)
    assert found.summary[0].startswith("9 logs predicted from the initial angle")
    assert found.summary[1].startswith("Use with care: p1, p4, p2, p3, coulomb and delay without")
    assert found.drawn is None
    known = bf.predict(data, LumpedParameters(**own), bands=False)
    assert known.rows() == found.rows()
    wrong = bf.predict(data, own | {"p1": 3 * own["p1"]})
    assert "The model does not follow" in wrong.summary[0]
    assert wrong.standing == "do not use"
    aside = bf.predict(data, own | {"zero": 0.2})
    assert aside.rows()[0]["FIT in %"] < found.rows()[0]["FIT in %"] - 20
    told = bf.predict(data.with_zero(Known(value=0.0)), own | {"zero": 0.2})
    assert told.rows() == aside.rows()


def test_the_model_error_of_fitted_logs_is_not_said_of_logs_that_are_not_followed(result):
    still = [replace(log, angle=np.roll(log.angle, 1500)) for log in result.data.logs]
    found = bf.predict(DataSet.of(still, name="late"), result, bands=False)
    assert found.standing == "do not use"
    assert not any(line.startswith("Model: error") for line in found.verdict)
    followed = bf.predict(result.data, result, bands=False)
    assert any(line.startswith("Model: error") for line in followed.verdict)


def test_a_gain_that_is_not_given_is_fitted_and_said(data, result):
    found = bf.predict(data.take([0, 5]), {"p1": result.parameters.p1, "p3": result.parameters.p3})
    assert any(each.startswith("p4 was not given; p4 = 0.0") for each in found.summary)


def test_slips_in_given_parameters_are_named(data, quick):
    for told, expected in (
        ({"p1": 0.003}, "p3: got nothing"),
        ({"p1": 0.003, "p3": "much"}, "a number"),
        ({"p1": 0.003, "p3": 0.05, "p4": 0.02, "zero": "up"}, "an angle in rad"),
    ):
        with pytest.raises(bf.InputError, match=expected):
            bf.predict(data, told)
    with pytest.raises(bf.InputError, match="p4: got nothing"):
        bf.predict(quick, {"p1": 0.003, "p3": 0.05})
    with pytest.raises(bf.IdentifiabilityError, match="bands need an identification"):
        bf.predict(data, {"p1": 0.003, "p3": 0.05, "p4": 0.02}, bands=True)
