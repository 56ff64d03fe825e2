"""A slide's results speak of kg and m."""

import numpy as np
import pytest

import butterfly as bf
from butterfly.identification.estimators import WeakForm
from tests.independent.integrator import Joint, motion


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
