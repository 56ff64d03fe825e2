"""The command line."""

import os
import sys

from butterfly.progress import ONE_THREAD


def main() -> None:
    """Run the command line (see `butterfly.cli.app.main`).

    Logs are simulated on all cores; threads of a matrix library would only compete with them.
    """
    os.environ.update(ONE_THREAD | dict(os.environ))  # read as NumPy is imported
    try:
        from butterfly.cli import app  # noqa: PLC0415 - whoever imports one module needs no other
    except KeyboardInterrupt:
        sys.exit(130)
    app.main()
