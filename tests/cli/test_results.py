"""Results of sweeps are listed, shown, tabulated, cleaned up and compared."""

import pyarrow as pa

from butterfly.cli.results import show_rows

COLUMNS = {"number": [0, 1], "key": ["ab12", "cd34"], "plant.encoder.noise": [0.0, 3e-4]}
COLUMNS |= {"plant.clock.step": [0.001, 0.001], "status": ["ok", "ok"], "deviation": [0.01, -0.02]}
COLUMNS |= {"fit_median": [99.1, 98.2], "orbit_rounds": pa.array([None, None], pa.int64())}
TABLE = pa.table(COLUMNS)


def test_what_is_the_same_is_told_once_and_what_is_empty_or_long_not_at_all(capsys):
    show_rows("runs", TABLE, asked=False)
    out = " ".join(capsys.readouterr().out.split())
    assert "Same in all rows: clock step 0.001 s, status ok." in out
    for told in ("0.0003", "Not shown: key. To show columns: --columns"):
        assert told in out
    assert "ab12" not in out
    assert "orbit" not in out
    show_rows("runs", TABLE.select(["key", "status"]), asked=True)
    assert capsys.readouterr().out.split()[-4:] == ["ab12", "ok", "cd34", "ok"]


def test_no_rows_are_said_to_be_none_and_one_is_told_as_pairs(capsys):
    show_rows("runs", TABLE.slice(0, 0), asked=False)
    assert capsys.readouterr().out == "runs: no rows.\n"
    show_rows("runs", TABLE.slice(0, 1), asked=False)
    told = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["status", "ok"] in told
    assert ["encoder", "noise", "in", "rad", "0"] in told
    assert ["deviation", "in", "share", "of", "true", "0.01"] in told
    assert ["fit", "median", "in", "%", "99.1"] in told
