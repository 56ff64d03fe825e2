"""A campaign on a terminal: what begins is asked for, what moves is shown, what ends is said."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Sequence

import butterfly as bf
from butterfly.campaigns.callbacks import CampaignCallbacks
from butterfly.cli.output import note
from butterfly.errors import StoppedError
from butterfly.plant.motor import Reading

_EVERY = 0.1  # s from one live line to the next


class CampaignTerminal(CampaignCallbacks):
    """Shows a person what a campaign does, on standard error, and asks what only they can do.

    Parameters
    ----------
    asks
        Whether the first motion waits for Enter.
    """

    def __init__(self, *, asks: bool) -> None:
        self._asks = asks
        self._shown = -_EVERY  # s on the computer's clock
        self._shows = sys.stderr.isatty()

    def begin(self, announcement: Sequence[str]) -> None:
        """Say what will be played, and wait for Enter."""
        for sentence in announcement:
            note(sentence)
        note(
            "Ctrl-C ends it at any time: the drive is switched off, finished runs are kept, and "
            "the same command goes on."
        )
        if self._asks:
            _answered(
                "Keep clear of the joint, and the switch of its supply in reach. Press Enter to "
                "begin: "
            )

    def phase(self, sentence: str) -> None:
        """Say what begins, or what came of it."""
        self._clear()
        note(sentence)

    def cycle(self, reading: Reading, command: float) -> None:
        """Show angle and command in one line that changes."""
        now = time.monotonic()
        if not self._shows or now - self._shown < _EVERY:
            return
        self._shown = now
        line = f"{reading.time:8.1f} s   angle {reading.angle:+8.3f} rad   command {command:+9.4g}"
        sys.stderr.write("\r" + line[: shutil.get_terminal_size().columns - 1])
        sys.stderr.flush()

    def mount(self, mass: bf.AddedMass) -> None:
        """Ask a person to mount a mass, or to leave it on."""
        self._clear()
        wanted = str(mass) if mass.mass else "no added mass"
        _answered(
            f"The drive is off. The next run is with {wanted}: change what is mounted, or leave it "
            "so; let the joint hang, then press Enter: "
        )

    def _clear(self) -> None:
        """Empty the line that changes."""
        if self._shows:
            sys.stderr.write("\r\033[K")


def _answered(question: str) -> None:
    """Wait for Enter."""
    try:
        input(question)
    except EOFError:
        raise StoppedError(
            "stopped: nobody answers at the keyboard; the drive is off, finished runs are kept, "
            "and the same command goes on"
        ) from None
