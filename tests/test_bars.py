"""The page of speed has the benchmarks' bars, and says of each row whether it is met."""

from tests.benchmarks.bars import BARS, MISSED, rows_of_page


def test_the_page_has_each_bar_and_no_other():
    rows = rows_of_page().values()
    assert [(row[0], row[2], row[3]) for row in rows] == [
        (what, str(bar), bar.of) for what, bar in BARS.items()
    ]


def test_a_row_is_called_missed_where_its_figure_is_and_where_that_is_known():
    rows = [row for row in rows_of_page().values() if row[1] != "missing"]
    missed = {row[0] for row in rows if not BARS[row[0]].met(float(row[1]))}
    assert missed == {row[0] for row in rows if "**missed**" in row[4]}
    assert missed <= MISSED
