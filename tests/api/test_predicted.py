"""What is predicted, and drawn: its rows, bands and files."""

import csv
import shutil

import mujoco
import numpy as np
import pytest
from mujoco import rollout
from pyarrow import parquet

import butterfly as bf
from butterfly.identification.predict import LEAST, OF_NEW_LOG, OF_PARAMETERS
from butterfly.model.parameters import LumpedParameters
from butterfly.progress import budget
from butterfly.report.page import rendered


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


@pytest.mark.usefixtures("brief_twins")
def test_draws_are_files_a_frame_models_and_a_batch(few, tmp_path):
    drawn = bf.draws(few, 3, seed=3)
    assert bf.draws(few, 3, seed=3).rows() == drawn.rows()
    assert len(bf.draws(few, LEAST + 1).rows()) == LEAST + 1
    assert all(isinstance(each, LumpedParameters) for each in drawn.parameters)
    assert len(drawn.figures()["corner"].data) == 36  # of 6 parameters, and 15 pairs with ellipses
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


def test_what_is_loaded_says_nothing_of_a_search_that_goes_on(predicted, tmp_path):
    predicted.save(tmp_path / "p.json")
    with budget(0.0) as search:
        search.left_out.append("something")
        again = bf.load(tmp_path / "p.json")
    assert again.summary == predicted.summary
