"""What is neither an answer nor a line, of a reader and of a command."""

import contextlib
import io
import re
import sys
from collections.abc import Callable
from unittest import mock

from butterfly.cli.app import main
from butterfly.errors import ButterflyError

LONGEST_LINE = 2000
REFUSED = 2
_PROGRESS = re.compile(r"^.* (done|all logs), \d+ s.*\n", re.MULTILINE)


def escape_of(read: Callable[[], object]) -> str:
    """Read, and tell what escapes; nothing if it ends in an answer or in a line."""
    try:
        read()
    except ButterflyError as error:
        length = len(str(error))
        return f"a message of {length} characters" if length > LONGEST_LINE else ""
    except Exception as escape:  # it is counted, not hidden
        return f"{type(escape).__name__}: {escape}"
    return ""


def escape_of_command(*words: object) -> str:
    """Run a command, and tell what is neither an answer nor one line on standard error."""
    out, err = io.StringIO(), io.StringIO()
    code = 0
    argv = ["butterfly", *map(str, words)]
    with (
        mock.patch.object(sys, "argv", argv),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            main()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        except Exception as escape:  # it is counted, not hidden
            return f"{words[0]}: {type(escape).__name__}: {escape}"
    said = _PROGRESS.sub("", err.getvalue())
    if code == REFUSED and (said.count("\n") != 1 or not said.startswith("error: ")):
        return f"{words[0]}: refused in {said.count(chr(10))} lines: {said[:200]}"
    if len(said) > LONGEST_LINE or "Traceback" in said + out.getvalue():
        return f"{words[0]}: {len(said)} characters on standard error: {said[:200]}"
    return ""
