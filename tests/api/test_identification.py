"""An identification: its table, its model, and what its parameters are made of."""

import sys
from dataclasses import replace

import numpy as np
import pytest

import butterfly as bf
from butterfly.api.identification import Identification, IdentifiedModel
from butterfly.identification.estimators import WeakForm
from butterfly.identification.identify import simulated
from tests.independent.integrator import Joint, motion


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


def test_without_pandas_a_frame_says_what_to_install(result, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(bf.ButterflyError, match=r"butterfly-testbed\[pandas\]"):
        result.to_dataframe()


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


@pytest.mark.usefixtures("brief_twins")
def test_a_slide_s_table_is_in_kilograms_and_it_is_exported_as_a_slide(tmp_path):
    time = 4e-3 * np.arange(1520)
    command = np.repeat([0.8, -1.0, 0.3, 1.0, -0.9, -0.4, 0.7, -0.6], 190)
    way, _ = motion(Joint(2.0, 4.0, 0.0, 3.0, coulomb=0.5), time, command)
    table = {"time": time, "input": command, "angle": 1e3 * way}
    data = bf.read(table, joint="slide", units={"angle": "mm"}, known={"p4": 3.0})
    found = bf.identify(data, WeakForm(terms=()))
    units = {row["parameter"]: row["unit"] for row in found.rows()}
    assert (units["p1"], units["p2"], units["coulomb"]) == ("kg", "N s/m", "N")
    assert "kg m²" not in repr(found) + str(found)
    found.report(tmp_path / "slide.html")
    page = (tmp_path / "slide.html").read_text(encoding="utf-8")
    assert "p₁ θ̈ + p₂ θ̇ + T_c sgn θ̇ = p₄ u(t − delay), for the bare slide, θ its position." in page
    assert "mass that moves" in page
    assert "Resonances" not in page
    panels = found.plot.frequency_response().to_dict()["layout"]
    assert panels["yaxis2"]["title"]["text"] == "phase in °"
    assert "yaxis3" not in panels  # without sines there is nothing measured
    written = found.model.export(tmp_path / "slide.xml")
    assert 'type="slide"' in written.text
    assert written.accuracy.unit == "m"


def test_an_answer_and_what_it_answers_have_one_state(few):
    found = simulated(few.data, few.estimate)
    answer = Identification.of(found)
    assert vars(answer) is vars(found)
    assert answer.free_runs is found.free_runs
