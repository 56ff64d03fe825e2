"""The command line: what is typed, what is printed, and how it ends."""

import sys


def main() -> None:
    """Run the command line (see `butterfly.cli.app.main`)."""
    try:
        from butterfly.cli import app  # noqa: PLC0415 - whoever imports one module needs no other
    except KeyboardInterrupt:  # before there is anything to say
        sys.exit(130)
    app.main()
