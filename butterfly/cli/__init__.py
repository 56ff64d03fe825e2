"""The command line: what is typed, what is printed, and how it ends."""


def main() -> None:
    """Run the command line (see `butterfly.cli.app.main`)."""
    from butterfly.cli import app  # noqa: PLC0415 - whoever imports one module needs no other

    app.main()
