"""A table as lines of text, and the log that is read of it."""

import numpy as np

from butterfly.logs.formats import read_log
from butterfly.logs.log import InputKind

KIND = {"input_kind": InputKind.VOLTAGE}
NAMES = ("time", "input", "angle")
HEAD = ",".join(NAMES)
FIRST_THREE = {"time": 0, "input": 1, "angle": 2}
TABLE = np.column_stack(
    [np.arange(24) * 0.01, np.sin(np.arange(24.0)), 1e-7 * np.cos(np.arange(24.0))]
)


def texts(separator=",", decimal="."):
    """Return a line per row of the table."""
    return [separator.join(repr(v).replace(".", decimal) for v in row) for row in TABLE.tolist()]


def read_lines(folder, lines, columns=None, encoding="utf-8"):
    """Read the log in lines of text."""
    path = folder / "log.txt"
    path.write_bytes("\n".join([*lines, ""]).encode(encoding, "surrogateescape"))
    return read_log(path, columns, **KIND)


def assert_table(log):
    """Assert that a log holds the rows of the table, as many as it has."""
    for name, column in zip(NAMES, TABLE.T, strict=True):
        np.testing.assert_array_equal(getattr(log, name), column[: log.time.size])


ROWS = texts(";")
