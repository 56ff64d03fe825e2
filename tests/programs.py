"""Programs that tests start."""

import subprocess


def said(*command, **how):
    """What a program says, if nothing fails."""
    ran = subprocess.run(command, check=True, capture_output=True, text=True, **how)  # noqa: S603
    return ran.stdout
