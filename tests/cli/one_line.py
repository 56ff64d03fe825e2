"""A command as a program of its own; that its input is bad, that it is done, that tables fit."""

import contextlib
import io
import subprocess
import sys

import pytest

from butterfly.cli.output import show_table


def program(*call, stdout=subprocess.PIPE, **how):
    """Run a command in a process of its own; return exit code, stdout and stderr."""
    words = [sys.executable, "-m", "butterfly", *map(str, call)]
    pipes = {"stdout": stdout, "stderr": subprocess.PIPE}
    ended = subprocess.run(words, **pipes, text=True, check=False, **how)  # noqa: S603 - our own
    return ended.returncode, ended.stdout, ended.stderr


def done(result):
    """What was printed, and nothing beside it."""
    code, out, err = result
    assert (code, err) == (0, "")
    return out


def assert_one_line_error(result, *parts):
    code, _, err = result
    assert code == 2
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    for part in parts:
        assert str(part) in err


def assert_tables_fit(out):
    """Each line of a table fits 80 columns, whatever the sentences around it."""
    lines = out.splitlines()
    tables = [line for line in lines if line.startswith("  ")]
    assert tables
    assert [line for line in tables if len(line) > 80] == []
    assert not any(line.endswith(" ") for line in lines)


def printed_table(width, *table, **how):
    """Lines of a table on a terminal of this width."""
    out = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(out):
        patch.setenv("COLUMNS", str(width))
        show_table(*table, **how)
    return out.getvalue().splitlines()


def assert_one_block(table):
    """A table of an answer stands side by side within 80 columns, under its title."""
    lines = printed_table(80, table.title, table.headers, table.rows)
    title, block = [part for part in "\n".join(lines).split("\n\n") if part.strip()]
    assert title.strip() == table.title
    assert all(len(line) <= 80 for line in block.splitlines())
