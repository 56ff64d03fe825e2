"""Results show, tabulate, save and report themselves; verbs take whatever holds data."""

import json
import re
import shutil
import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

import butterfly as bf
from butterfly.api.identification import IdentifiedModel
from butterfly.files import write_document
from butterfly.identification.design import masses_at_hand
from butterfly.identification.estimators import OutputError
from butterfly.identification.validate import Split, cross_validate
from butterfly.logs.mat import write_mat
from tests.api.conftest import OF_ESTIMATE, OTHERS, results_of
from tests.verdicts import follow_nothing


def test_a_zero_is_told_of_logs_and_of_whatever_is_read(quick_data, data):
    log = bf.Log(*(getattr(data.logs[0], name) for name in ("time", "input", "angle")), zero=0.2)
    for told in (bf.read(quick_data, zero=0.2), bf.read(data, zero=(0.2, 0.0)), bf.read(log)):
        assert {each.value for each in told.offsets} == {0.2}
        assert told.unread == []
    with pytest.raises(bf.InputError, match="zero"):
        bf.read(data, zero="left")


def test_the_encoder_s_zero_is_a_row_of_the_answer_is_saved_and_reaches_the_twin(results, tmp_path):
    found = results["identification"]
    found.save(tmp_path / "r.json")
    loaded, (zero,) = bf.load(tmp_path / "r.json"), {*found.zeros.values()}
    assert zero == found.estimate.local[None]["zero"]
    row = ("zero", f"{zero:z.4f}", "", "rad", "encoder's angle less the model's")
    for each in (found, loaded):
        assert row in [line for table in each.tables() for line in table.rows]
        assert each.to_dict()["zeros"] == dict.fromkeys(found.fits, zero)
        assert each.model.twin().zeros == (*found.zeros.values(),)


def shown(result):
    """What a result shows on a console, in a frame, on its page without figures."""
    page = result.page()
    return (
        *(str(result), repr(result), result.paragraphs(), result.tables(), result.rows()),
        *(page.name, page.description, page.headed, page.summary, page.facts),
        [(table.headers, [*table.rows]) for part in page.parts for table in part.tables],
    )


@pytest.mark.parametrize("kind", [*OF_ESTIMATE, *OTHERS])
def test_a_result_says_its_verdict_first_shows_saves_and_reports_itself(results, kind, tmp_path):
    each = results[kind]
    if kind not in {"leaderboard", "change", "inspection", "one log"}:  # which rest on no one fit
        assert each.standing == each.to_dict()["verdict"] == "good"
        lines = each.page().verdict.lines
        assert tuple(each.verdict[:2]) == each.summary[:2] == lines
        assert lines[0].startswith("Good: p1 ±")
        assert lines[1].startswith("Model: error ")
    assert len(repr(each).splitlines()) == 1
    assert "good" not in repr(each)
    assert len(each.to_dataframe()) == len(each.rows()) > 0
    assert "<table" in each._repr_html_()
    each.save(tmp_path / "r.json")
    again = bf.load(tmp_path / "r.json")
    assert again.to_dict() == each.to_dict()
    assert shown(again) == shown(each)
    pd.testing.assert_frame_equal(again.to_dataframe(), each.to_dataframe())
    again.report(tmp_path / "page.html")
    assert (tmp_path / "page.html").stat().st_size > 5e3


def test_a_result_not_to_be_used_says_so_in_its_repr_and_its_words(few, monkeypatch):
    follow_nothing(monkeypatch)
    for each in results_of(bf.identify(few.data, terms=())).values():
        assert each.standing == "do not use"
        assert each.verdict[0].startswith("Do not use: ")
        assert str(each).splitlines()[1] == each.verdict[0]
        assert ", do not use" in repr(each)


def test_the_table_of_parameters_is_aligned_and_has_values_units_and_intervals(result):
    assert "p1 0.0032" in repr(result)
    assert "Good: p1 ±" in str(result)
    lines = str(result).splitlines()
    assert [line.split()[0] for line in lines[-6:]] == ["p1", "p2", "p3", "p4", "coulomb", "delay"]
    assert len({len(line) for line in lines[-7:]}) == 1
    frame = result.to_dataframe().set_index("parameter")
    assert frame.loc["p1", "value"] == result.parameters.p1
    assert frame.loc["p4", "unit"] == "N m/V"
    assert frame.loc["p1", "lower"] < 0.00325 < frame.loc["p1", "upper"]
    origin = {**result.origin, "name": "<b>x"}
    html = replace(result, logs=None, origin=origin, saved={"summary": []})._repr_html_()
    assert all(each in html for each in ("<td>p1<small>", "&lt;b&gt;x"))


def test_what_parameters_are_made_of_is_told_of_what_is_known(result, tmp_path):
    made_of = {"hand_mass": (0.1, 0.001), "back_emf_constant": 0.05}
    found = result.physical(**made_of)
    table = found.to_dataframe().set_index("parameter")
    assert table.loc["com_distance", "value"] == pytest.approx(0.05, rel=0.01)
    assert table.loc["com_distance", "standard_error"] == pytest.approx(5e-4, rel=0.05)
    assert table.loc["viscous_friction", "value"] == pytest.approx(2e-4, rel=0.1)
    assert "k_t and R enter only as p4 = N k_t/R" in str(found)
    result.save(tmp_path / "r.json")
    assert bf.load(tmp_path / "r.json").physical(**made_of).rows() == found.rows()
    derived = {row["parameter"]: row for row in result.physical().rows()}
    assert derived.keys() == {"resonance", "damping_ratio", "decay_time", "speed_gain"}
    assert derived["resonance"]["value"] == pytest.approx(result.model.resonance())
    assert derived["speed_gain"]["unit"] == "rad/s/V"
    assert result.to_dict()["physical"].keys() == derived.keys()
    assert any("resonance" in row[0] for table in result.tables() for row in table.rows)
    for name in ("p4", "mass"):
        with pytest.raises(bf.InputError, match=name):
            result.physical(**{name: 1.0})
    told = replace(result, origin=result.origin | {"known": {"hand_mass": 0.1}})
    with pytest.raises(bf.InputError, match=r"hand_mass: got 0\.2; expected what was not known"):
        told.physical(hand_mass=0.2)


def test_what_was_saved_is_a_model_and_finds_its_logs(result, data, tmp_path):
    assert result.to_dict()["data"]["manifest"]["root"] is None
    result.save(tmp_path / "r.json")
    again = bf.load(tmp_path / "r.json")
    np.testing.assert_array_equal(again.covariance, result.covariance)
    assert again.estimate.left_out.keys() == result.estimate.left_out.keys()
    assert again.model.resonance() == result.model.resonance()
    assert again.data.logs[0].source == data.logs[0].source
    assert again.plot.time(0).data[1].name == "measured"


def test_a_result_above_its_logs_is_moved_with_them_and_any_finds_them_where_one_says(
    quick_data, tmp_path, monkeypatch
):
    shutil.copytree(quick_data, tmp_path / "a/logs")
    monkeypatch.chdir(tmp_path)
    found = bf.identify("a/logs", terms=())
    found.save("a/r.json")
    shutil.move("a", "b")
    monkeypatch.chdir("/")
    assert bf.load(tmp_path / "b/r.json").data.logs[0].name == found.data.logs[0].name
    shutil.move(tmp_path / "b/r.json", tmp_path / "r.json")
    with pytest.raises(bf.InputError, match="no such file"):
        _ = bf.load(tmp_path / "r.json").data
    assert bf.load(tmp_path / "r.json", root=tmp_path / "b/logs").data.logs


def test_local_values_and_unknown_ones_come_back(data, by_thesis, tmp_path):
    local = bf.identify(data.take([0, 5]), OutputError(terms=(), per_log=("zero",)))
    unknown = dict.fromkeys(by_thesis.estimate.resonances, float("nan"))
    lost = replace(by_thesis, estimate=replace(by_thesis.estimate, resonances=unknown))
    for each in (local, by_thesis, lost):
        each.save(tmp_path / "r.json")
        again, before = bf.load(tmp_path / "r.json").estimate, each.estimate
        assert again.local == before.local
        assert again.resonances.keys() == before.resonances.keys()
        np.testing.assert_array_equal([*again.resonances.values()], [*before.resonances.values()])
        np.testing.assert_array_equal(again.covariance, before.covariance)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "butterfly.report"}, "schema: got butterfly.report; expected a saved result"),
        ({"schema": []}, "schema: got"),
        ({"schema_number": 4}, "update butterfly"),
        ({"schema_number": 0}, "save again"),
        ({"schema_number": None}, "save again"),
        ({"parameters": {}}, "content: got KeyError"),
        ({"fits": 3}, "content: got AttributeError"),
        ({"data": None}, "content: got AttributeError"),
        ({"data": {}}, "content: got KeyError"),
        ({"summary": "abc"}, "content: got TypeError"),
        ({"summary": [1]}, "content: got TypeError"),
        ({"estimator": 3}, "content: got TypeError"),
    ],
)
def test_another_file_is_refused_with_what_to_do(result, tmp_path, change, message):
    path = tmp_path / "r.json"
    path.write_text(json.dumps(result.to_dict() | change))
    with pytest.raises(bf.InputError, match=message):
        bf.load(path)


def _damaged(content):
    """Yield a mapping with each value replaced by another, or left out."""
    for key in content:
        for other in (None, [], {}, 0, "x", [[1.0]], [["a", "b"]]):
            yield {**content, key: other}
        yield {name: value for name, value in content.items() if name != key}


@pytest.mark.parametrize("part", [None, "data", "covariance", "parameters"])
def test_no_damage_passes_and_fails_later(few, tmp_path, part):
    path, whole = tmp_path / "r.json", few.to_dict()
    for damaged in _damaged(whole if part is None else whole[part]):
        path.write_text(json.dumps(damaged if part is None else {**whole, part: damaged}))
        with suppress(bf.InputError):
            loaded = bf.load(path)
            repr(loaded), str(loaded), loaded._repr_html_(), loaded.to_dict()
            if part == "data":
                bf.changed(loaded, loaded)


@pytest.mark.parametrize("kind", ["physical", "validation", "leaderboard", "comparison", "model"])
def test_rows_that_are_gone_or_lack_a_column_are_refused(results, kind, tmp_path):
    whole, key = results[kind].to_dict(), type(results[kind]).table
    first, *others = whole[key]
    lacking = [
        {k: v for k, v in first.items() if k != name}
        for name in first
        if others and kind != "leaderboard"
    ]
    for rows in ([], *([each, *others] for each in lacking)):
        write_document({**whole, key: rows}, tmp_path / "r.json")
        with pytest.raises(bf.InputError, match="content: got"):
            bf.load(tmp_path / "r.json")
        (tmp_path / "r.json").unlink()


def test_a_log_without_a_fit_is_left_out_of_tiles_and_tables(results):
    found = results["validation"]
    content = json.loads(json.dumps(found.to_dict()))
    worst = min(content["rows"], key=lambda row: row["FIT held out in %"])
    worst["FIT held out in %"] = None
    again = type(found).from_dict(content)
    assert again.facts()[1].value != found.facts()[1].value
    assert [row[-1] for row in again.tables()[1].rows] == ["4 of 4", "3 of 3"]
    assert again.page().figures


def test_a_narrow_interval_by_bootstrap_is_not_rounded_away(results):
    content = results["validation"].to_dict()
    p1 = content["parameters"]["p1"]["value"]
    drawn = {"p1": {"lower": p1 * (1 - 1e-6), "upper": p1 * (1 + 1e-6)}}
    (row,) = type(results["validation"]).from_dict(content | {"bootstrap": drawn}).tables()[-1].rows
    assert len({*row[1:4]}) == 3


def test_what_has_no_verdict_says_none(results):
    found = results["validation"]
    content = {key: value for key, value in found.to_dict().items() if key != "verdict"}
    older = type(found).from_dict(content)
    assert (older.standing, older.verdict, older.to_dict()["verdict"]) == (None, [], None)
    assert older.page().summary == list(found.summary)


def test_what_an_older_program_saved_is_refused_in_a_line():
    with pytest.raises(bf.InputError, match="schema_number: got 1; expected 3: identify and save"):
        bf.load(Path(__file__).parents[1] / "data/older/identification.json")


@pytest.mark.parametrize("kind", ["comparison", "draws", "residual", "validation"])
def test_an_older_result_of_a_kind_whose_keys_changed_is_to_be_saved_again(results, kind, tmp_path):
    write_document(results[kind].to_dict() | {"schema_number": 3}, tmp_path / "r.json")
    with pytest.raises(bf.InputError, match=r"got 3; expected 4: .* save again"):
        bf.load(tmp_path / "r.json")


@pytest.mark.parametrize("text", ["", "[1]", "{", "[" * 100_000, "\x00"])
def test_what_is_no_json_is_refused(tmp_path, text):
    path = tmp_path / "r.json"
    path.write_text(text)
    with pytest.raises(bf.InputError, match="saved result"):
        bf.load(path)


def test_a_result_of_arrays_says_that_its_logs_are_not_to_be_found(data, tmp_path):
    found = bf.identify(list(data.recorded), terms=())
    found.save(tmp_path / "r.json")
    again = bf.load(tmp_path / "r.json")
    with pytest.raises(bf.InputError, match="from one source of files"):
        _ = again.data
    with pytest.raises(bf.InputError, match="from one source of files"):
        again.report(tmp_path / "r.html", figures=True)
    assert again.page().summary[0].startswith("Without figures: the logs cannot be read")
    assert again.page().lead.tables[0].rows == found.page().lead.tables[0].rows


def test_what_the_tables_hold_is_what_the_verbs_find(data, results):
    held = cross_validate(data, OutputError(terms=()), Split.MASS)
    left_out = bf.validate(data, terms=()).to_dataframe()["FIT held out in %"]
    np.testing.assert_allclose(left_out, held.fits)
    designed, compared = results["design"].rows(), results["comparison"]
    assert designed[0]["robot time in s"] == min(row["robot time in s"] for row in designed)
    assert compared.to_dataframe()["simulators apart in rad"].max() < 3e-3
    titles = [part.title for part in compared.page().parts]
    assert titles == ["At a glance", "Measured against simulated", "In numbers", "Residuals"]
    plain, left = compared.tables()
    assert all(re.fullmatch(r"[+-]\d+\.\d\d", cell) for cell in plain.rows[0][4:])
    assert left.headers == results["residual"].tables()[0].headers
    for kind in ("comparison", "residual"):
        assert results[kind].page().parts[-1].tables[-1].caption.startswith("Error: rms of")
    documents = [results[kind].to_dict() for kind in ("comparison", "residual")]
    assert [len(each["residuals"]["logs"]) for each in documents] == [4, 4]
    assert all(each["residuals"]["findings"] != each["findings"] != [] for each in documents)


def test_the_rows_of_a_choice_are_sets_of_terms_those_of_a_robot_its_parameters(results, quick):
    chosen = results["selection"]
    assert "in turn, the terms predict what was left out with a mean FIT of 9" in chosen.notes[-1]
    first, shown = chosen.rows()[0], chosen.shown_rows()[0]
    assert (first["terms"], shown["terms"]) == ([], "none")
    assert float(shown["FIT in sample in %"]) == pytest.approx(first["in_sample"]["median"], 0.01)
    units = {row["parameter"]: row["unit"] for row in bf.inspect(quick).rows()}
    assert [*units][:4] == ["p1", "p2", "p3", "p4"]
    assert (units["p1"], units["p4"]) == ("kg m²", "N m/V")


def test_several_sources_are_read_together_each_with_its_own_repairs(data, sine_log, tmp_path):
    spoilt = replace(sine_log, angle=np.where(np.arange(40_000) == 7, np.nan, sine_log.angle))
    write_mat(spoilt, tmp_path / "a.mat")
    manifest = {"name": "a", "input": "voltage", "arm": 0.1, "repair": ["non_finite"]}
    manifest["logs"] = [{"file": "a.mat", "added_mass": 0.05}]
    manifest["known"] = {"p4": 0.5}
    (tmp_path / "manifest.yaml").write_text(yaml.safe_dump(manifest))
    together = bf.read([tmp_path, data, sine_log])
    assert len(together.logs) == 1 + len(data.logs) + 1
    assert together.known.fixed == {"p4": 0.5}
    assert bf.read([tmp_path]).manifest is not None


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


def test_logs_are_made_of_lists_and_frames_alike():
    time = np.linspace(0, 1, 50)
    frame = pd.DataFrame({"t": time, "u": np.sin(time), "q": np.cos(time), "dq": -np.sin(time)})
    one = bf.Log.from_frame(frame, time="t", input="u", angle="q", velocity="dq")
    two = bf.Log(list(time), frame["u"], tuple(frame["q"]), frame["dq"], input_kind="torque")
    for name, column in one.columns().items():
        assert column.dtype == np.float64
        np.testing.assert_array_equal(column, two.columns()[name])
    assert two.input_kind is bf.InputKind.TORQUE
    assert len(repr(one).splitlines()) == 1


def test_without_pandas_a_frame_says_what_to_install(result, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(bf.ButterflyError, match=r"butterfly-testbed\[pandas\]"):
        result.to_dataframe()


def test_the_next_run_is_not_proposed_twice_for_masses_that_load_alike(data):
    masses = masses_at_hand(data)
    loads = [(mass.inertia, mass.gravity_moment) for mass in masses]
    assert (0.0, 0.0) in loads
    assert len(set(loads)) == len(loads) == 3


def test_model_and_measured_response_meet_in_python_control(result, data):
    mass = data.masses[1]
    plant, measured = result.model.linearised(mass), result.measured(mass)
    assert plant.name == ("hand" if result.parameters.delay >= 0 else "hand_without_delay")
    late = replace(result.parameters, delay=0.005)
    system = IdentifiedModel(late).linearised(mass)
    for omega in measured.omega:
        modelled = system(1j * omega)[0, 0]
        assert modelled == pytest.approx(
            complex(IdentifiedModel(late).frequency_response(omega, mass)), rel=1e-6
        )
    fast = measured.omega[-1]
    gain = abs(measured(1j * fast)) / abs(plant(1j * fast)[0, 0])
    assert gain == pytest.approx(1, abs=0.1)  # Coulomb friction matters least there
    with pytest.raises(bf.InputError, match="added mass"):
        result.measured(bf.AddedMass(mass=1.0, arm=1.0))


def test_an_inspection_forecasts_on_the_logs_that_are_fitted(quick_data, results, tmp_path):
    found = results["inspection"]
    assert [row["word"] for row in found.content["before_fit"]] == ["identifiable"] * 6
    assert "identifiable" in found._repr_html_()
    found.save(tmp_path / "seen.json")
    again = bf.load(tmp_path / "seen.json")
    assert (again.before_fit, again.unusable) == (found.before_fit, 0)
    alone = bf.inspect(quick_data / found.rows()[0]["log"], known={"p4": 0.025})
    assert alone.rows()[0]["log"] in (cell := alone._repr_html_())
    assert "identifiable" in cell[cell.index("<table") :]
    assert results["one log"].before_fit == ()  # one log tells less than the data set
    told = bf.inspect(quick_data, holdout=["of no log", "*"])
    assert told.before_fit == ()  # the first pattern does not undo the second
