"""Rows of a sweep's tables: what differs side by side, what does not once."""

import pyarrow as pa
import pytest

from butterfly.cli.picked_rows import matching
from butterfly.cli.shown_rows import show_rows, shown_text

TABLE = pa.table(
    {
        "number": [0, 1],
        "key": ["ab12", "cd34"],
        "plant.encoder.noise": [0.0, 3e-4],
        "plant.clock.step": [0.001, 0.001],
        "status": ["ok", "ok"],
        "orbit_rounds": pa.array([None, None], pa.int64()),
    }
)


def test_what_is_the_same_is_told_once_and_what_is_empty_or_long_not_at_all(capsys):
    show_rows("runs", TABLE, 50, asked=False)
    out = capsys.readouterr().out
    assert "The same in all rows: clock step 0.001 s, status ok." in out
    assert "encoder noise, rad" in out
    assert "0.0003" in out
    assert "ab12" not in out
    assert "orbit" not in out
    assert "Not shown: key; --columns" in out


def test_columns_that_are_asked_for_are_shown(capsys):
    show_rows("runs", TABLE.select(["key", "status"]), 50, asked=True)
    out = capsys.readouterr().out
    assert "The same" not in out
    assert out.split()[-4:] == ["ab12", "ok", "cd34", "ok"]


def test_deviations_and_fits_are_headed_with_what_they_count_in(capsys):
    table = pa.table(
        {"number": [0, 1], "deviation": [0.01, -0.02], "fit_median": [99.1, 98.2], "true": [1, 2]}
    )
    show_rows("estimates", table, 50, asked=False)
    out = capsys.readouterr().out
    assert "deviation, share of true" in out
    assert "fit median, %" in out
    assert "true," not in out


def test_no_rows_are_said_to_be_none(capsys):
    show_rows("runs", TABLE.slice(0, 0), 50, asked=False)
    assert capsys.readouterr().out == "runs: no rows.\n"


def test_one_row_is_told_as_pairs(capsys):
    show_rows("runs", TABLE, 1, asked=False)
    told = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["status", "ok"] in told
    assert ["encoder", "noise,", "rad", "0"] in told


@pytest.mark.parametrize("name", ["plant.encoder.noise", "noise", "encoder.noise", "encoder noise"])
def test_a_column_is_named_by_its_path_its_last_part_or_its_header(name):
    assert matching(name, TABLE.column_names) == ["plant.encoder.noise"]


def test_a_last_part_of_two_columns_means_both():
    assert len(matching("mass", ["plant.hand.mass", "added_masses.1.mass"])) == 2


@pytest.mark.parametrize(
    ("value", "text"), [(None, "–"), (True, "yes"), (0.1234567, "0.123457"), (3, "3")]
)
def test_a_cell_is_written_as_a_person_reads_it(value, text):
    assert shown_text(value) == text
