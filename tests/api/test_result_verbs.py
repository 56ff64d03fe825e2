"""What is predicted, and drawn, from Python."""

import csv
import shutil
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mujoco import rollout
from pyarrow import parquet

import butterfly as bf
from butterfly.api.result_verbs import BAND_DRAWS
from butterfly.identification.parameter import CONFIDENCE
from butterfly.identification.predict import LEAST, OF_NEW_LOG, OF_PARAMETERS
from butterfly.model.parameters import LumpedParameters
from butterfly.model.prior import Known
from butterfly.progress import budget
from butterfly.report.page import rendered


def test_of_the_draws_of_a_band_five_are_expected_beyond_either_edge():
    assert pytest.approx(5.0) == BAND_DRAWS * (1 - CONFIDENCE) / 2


def test_a_prediction_has_rows_the_verdict_and_bands_in_time(predicted, data, result):
    rows = predicted.rows()
    assert [row["log"] for row in rows] == [log.name for log in data.logs]
    assert rows[0]["FIT in %"] == pytest.approx(result.fits[data.logs[0].name])
    for row in rows:
        assert 0 < row[f"{OF_PARAMETERS}: width in rad"] < row[f"{OF_NEW_LOG}: width in rad"]
    assert np.mean([row[f"{OF_NEW_LOG}: inside in %"] for row in rows]) > 85
    worst = min(rows, key=lambda row: row[f"{OF_NEW_LOG}: inside in %"])
    least = f"{worst[f'{OF_NEW_LOG}: inside in %']:.0f} %"
    assert f"(expected: 95 %); in {worst['log']} {least}, the least." in predicted.summary[3]
    assert predicted.facts()[-2].detail.endswith(f"worst log {least}")
    said = " ".join(predicted.summary)
    assert "60 parameter draws, all with the same weight." in said
    assert "9 logs, each predicted with its added mass held out" in said
    assert {*result.verdict} <= {*predicted.summary}
    page = rendered(predicted.page())
    assert "In time" in page
    assert (page.count("data-figure="), page.count("<option")) == (3, 9)


def test_an_experiment_is_predicted_by_its_inputs_alone(quick, result):
    plans = (quick, {"bands": False}), (bf.read_experiment(quick), {"draws": 40})
    for plan, options in plans:
        predicted = bf.predict(plan, result, **options)
        assert not predicted.measured
        assert predicted.verdict == [*predicted.summary[:2]]
        assert "no measurement to compare" in predicted.summary[2]
        assert not any("FIT" in name or "inside" in name for name in predicted.rows()[0])
    found = bf.simulate(quick)
    run, log = predicted.predictions[3].run, found.logs[3]
    np.testing.assert_array_equal(run.log.input, log.input)
    apart = np.sqrt(np.mean((run.simulated - log.angle) ** 2)) / np.std(log.angle)
    assert apart < 0.1
    assert predicted.page().sections[0].title == "In time"


def test_without_bands_there_are_fits_only(data, result):
    plain = bf.predict(data, result, bands=False)
    assert (plain.drawn, [*plain.rows()[0]][-1]) == (None, "FIT in %")
    assert [section.title for section in plain.page().parts] == ["At a glance", "In numbers"]


def test_without_the_logs_there_is_the_band_of_the_parameters_only(data, quick_data, tmp_path):
    shutil.copytree(quick_data, tmp_path / "logs")
    bf.identify(tmp_path / "logs", terms=()).save(tmp_path / "result.json")
    whole = bf.predict(data.logs[0], tmp_path / "result.json", draws=40)
    assert OF_NEW_LOG in whole.predictions[0].bands
    shutil.rmtree(tmp_path / "logs")
    part = bf.predict(data.logs[0], str(tmp_path / "result.json"), draws=40)
    assert list(part.predictions[0].bands) == [OF_PARAMETERS]
    assert "The logs cannot be read" in str(part)
    assert "band of a new log is missing" in str(part)


def test_a_mass_beyond_those_seen_is_said_to_be(data, few, predicted):
    far = replace(data.logs[-1], added_mass=bf.AddedMass(mass=0.3, arm=0.104))
    said = bf.predict(far, few, draws=40).summary
    assert any("300 g at 104 mm: extrapolation beyond the added masses" in each for each in said)
    assert not any("beyond" in each for each in predicted.summary)


def test_an_estimate_that_left_no_mass_out_says_so(data):
    rest = bf.read([log for log in data.logs if log.added_mass.mass > 0])
    found = bf.identify(rest, terms=())
    assert "may be too narrow for another mass" in str(bf.predict(rest.logs[0], found, draws=40))


@pytest.mark.usefixtures("brief_twins")
def test_draws_are_files_a_frame_models_and_a_batch(few, tmp_path):
    drawn = bf.draws(few, 3, seed=3)
    assert bf.draws(few, 3, seed=3).rows() == drawn.rows()
    assert len(bf.draws(few, LEAST + 1).rows()) == LEAST + 1
    assert all(isinstance(each, LumpedParameters) for each in drawn.parameters)
    assert len(drawn.figures()["corner"].data) == 21  # of 6 parameters, and pairs of them
    for name in ("draws.csv", "draws.parquet", "models"):
        drawn.write(tmp_path / name)
    with (tmp_path / "draws.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [*rows[0]][:2] == ["p1 [kg m²]", "p2 [N m s/rad]"]
    assert [key.split(" [")[0] for key in rows[0]] == [*few.estimate.names]
    table = parquet.read_table(tmp_path / "draws.parquet").to_pylist()
    assert table == [{key: float(text) for key, text in row.items()} for row in rows]
    assert [[*row.values()] for row in table] == [[*row.values()] for row in drawn.rows()]
    assert len(list((tmp_path / "models").glob("*.xml"))) == 3
    batch = drawn.batch(bf.AddedMass(mass=0.05, arm=0.104), hand_mass=0.2)
    assert len({float(model.dof_M0[0]) for model in batch}) == 3
    data = mujoco.MjData(batch[0])
    size = mujoco.mj_stateSize(batch[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    start = np.zeros(size)
    mujoco.mj_getState(batch[0], data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    command = np.zeros((3, 50, batch[0].nu))
    command[:, :, 0] = 1.0
    states, _ = rollout.rollout(batch, data, np.tile(start, (3, 1)), command)
    assert len({float(angle) for angle in states[:, -1, 1]}) == 3
    continuous, discrete = drawn.linear_systems(), drawn.linear_systems(step=0.01)
    assert len({float(system.B[1, 0]) for system in continuous}) == 3
    assert {system.dt for system in discrete} == {0.01}


def test_what_was_held_is_drawn_too(data):
    few = data.take([0, 5, 7])
    found = bf.identify(few, "output-error", terms=(), fixed=("delay",))
    drawn = bf.draws(found, 40)
    assert {row["delay"] for row in drawn.rows()} == {found.parameters.delay}
    assert drawn.parameters[0].delay == found.parameters.delay


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


def test_what_is_loaded_says_nothing_of_a_search_that_goes_on(predicted, tmp_path):
    predicted.save(tmp_path / "p.json")
    with budget(0.0) as search:
        search.left_out.append("something")
        again = bf.load(tmp_path / "p.json")
    assert again.summary == predicted.summary


def test_given_parameters_are_judged_by_how_they_move(data, own):
    found = bf.predict(data, own)
    assert found.summary[0].startswith("Use with care: p1, p4, p2, p3, coulomb and delay without")
    assert found.summary[1].startswith("9 logs predicted from the initial angle")
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
