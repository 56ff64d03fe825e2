"""Claims about a figure, and how a figure is written."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.report.page import PageTable
from butterfly.report.thesis_page import drawn, write_thesis
from butterfly.thesis.tables import HEADERS, Claim, Row, ThesisFigure, compared, near


def test_numbers_agree_within_a_share_or_a_bound():
    assert near("a", 2.0, 2.01).holds
    assert not near("a", 2.0, 2.03).holds
    assert near("a", 0.0, 0.5, within=0.6).holds


def test_a_figure_is_written_as_numbers_pictures_and_a_page(synthetic, tmp_path):
    about = {"omega": np.array([1.0, 2.0]), "gain": np.array([3.0, 4.0])}
    words = ("crosses", {"case": np.array(["a", "b"]), "share": np.array([0.0, 1.0])})
    claims = [Claim("one (here 1)", True), Claim("two (here 3)", False)]
    small = ThesisFigure("small", "A title", ("x", "y"), {"a": ("line", about)}, claims)
    named = replace(small, name="named", curves={"b": words})
    figures = [small, named, synthetic["figure_07"]]
    table = PageTable(title="Values", headers=HEADERS, rows=compared([Row("Table 1", "2", "3")]))
    page = write_thesis(tmp_path, figures, table, ["A note."], {"summary": ["A summary."]})
    for figure in figures:
        for ending in ("csv", "png", "svg"):
            assert (tmp_path / f"{figure.name}.{ending}").stat().st_size > 0
    assert (tmp_path / "small.csv").read_text() == "omega,gain\n1,3\n2,4\n"
    assert (tmp_path / "named.csv").read_text() == "case,share\na,0\nb,1\n"
    text = page.read_text(encoding="utf-8")
    assert "Agrees: one (here 1). Does not agree: two (here 3)." in text
    assert text.index("A summary.") < text.index("A note.") < text.index("reproduced</td>")
    marks = [trace for trace in drawn(synthetic["figure_07"]).data if trace.mode == "lines"]
    assert [trace.x[0] for trace in marks] == pytest.approx([3.8788, 3.774], abs=1e-4)
