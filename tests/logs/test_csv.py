import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.logs.csv import read_csv
from butterfly.logs.log import InputKind

KIND = {"input_kind": InputKind.VOLTAGE}


def _write(path, header, rows=20):
    lines = [header] + [",".join(str(row + column) for column in range(4)) for row in range(rows)]
    path.write_text("\n".join(lines))
    return path


def test_columns_are_found_by_the_map_whatever_their_order(tmp_path):
    path = _write(tmp_path / "a.csv", "angle_rad,t_s,volts,extra")
    log = read_csv(path, {"time": "t_s", "input": "volts", "angle": "angle_rad"}, **KIND)
    np.testing.assert_array_equal(log.time, np.arange(20.0) + 1)
    np.testing.assert_array_equal(log.input, np.arange(20.0) + 2)
    np.testing.assert_array_equal(log.angle, np.arange(20.0))
    assert log.velocity is None


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (None, "time: got no such column; expected 'times'"),
        ({"time": "times", "input": "u"}, "columns.angle: got nothing"),
        (
            {"time": "times", "input": "u", "angle": "q", "speed": "x"},
            "columns.speed: got an unknown",
        ),
    ],
)
def test_a_wrong_map_is_named(tmp_path, columns, message):
    path = _write(tmp_path / "a.csv", "times,u,q,x")
    with pytest.raises(InputError, match=message):
        read_csv(path, columns, **KIND)


@pytest.mark.parametrize("cell", ["", "-", "nan"])
def test_a_velocity_without_numbers_that_nobody_asked_for_is_left_out(tmp_path, cell):
    path = tmp_path / "a.csv"
    path.write_text(
        "time,input,angle,velocity\n" + "".join(f"{k},1,{k},{cell}\n" for k in range(20))
    )
    log = read_csv(path, **KIND)
    assert log.velocity is None
    assert "velocity" in log.reading.layout[-1]
    np.testing.assert_array_equal(log.angle, np.arange(20.0))


def test_text_among_numbers_is_named(tmp_path):
    path = _write(tmp_path / "a.csv", "time,input,angle,x")
    path.write_text(path.read_text() + "\n1,oops,2,3")
    with pytest.raises(InputError, match="input: got 'oops' in line 22; expected a number"):
        read_csv(path, **KIND)


@pytest.mark.parametrize("content", [b"", b"\x00\xff\xfe", b"a,b\n1,2,3\n"])
def test_what_is_no_csv_is_one_typed_error(tmp_path, content):
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(InputError):
        read_csv(tmp_path / "a.csv", **KIND)
