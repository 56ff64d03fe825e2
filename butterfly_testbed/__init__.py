"""The command `butterfly-testbed`, which also says if another package took the name `butterfly`.

The index has a web terminal of 2018 named butterfly, with a module and a command of that name. If
both are installed, the files of the later one lie over those of the other. This module has a name
of its own, so it runs all the same.
"""

from __future__ import annotations

import sys
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec

_REMEDY = "pip uninstall butterfly butterfly-testbed, then install butterfly-testbed again"
_BAD_INPUT = 2


def other_package() -> str:
    """Return name and version of an installed package that shares its files; empty if none is."""
    try:
        return f"butterfly {version('butterfly')}"
    except PackageNotFoundError:
        return ""


def main() -> None:
    """Run the command line of butterfly, or say in a line why it cannot be run."""
    other = other_package()
    try:
        from butterfly.cli import main as run  # noqa: PLC0415 - another package may have its name
    except ImportError as error:
        origin = getattr(find_spec("butterfly"), "origin", None) or "nowhere"
        what = f"the package {other} lies over it" if other else f"{error} ({origin})"
        print(f"error: butterfly-testbed is not whole: {what}: {_REMEDY}", file=sys.stderr)
        sys.exit(_BAD_INPUT)
    if other:
        print(
            f"warning: {other} is another package with the same files: {_REMEDY}", file=sys.stderr
        )
    run()
