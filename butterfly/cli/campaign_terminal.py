"""A campaign on a terminal: it asks before it begins, shows the motion, and says how it ended."""

from __future__ import annotations

import select
import shutil
import sys
import textwrap
import time
from collections.abc import Sequence
from contextlib import suppress

import butterfly as bf
from butterfly.campaigns.campaign import CampaignCallbacks
from butterfly.cli.output import asked, put
from butterfly.errors import StoppedError, visible
from butterfly.plant.motor import Reading

_EMPTY = "\r\033[K"  # goes back in a line and empties it
_EVERY = 0.1  # s from one live line to the next


class CampaignTerminal(CampaignCallbacks):
    """Shows a person what a campaign does, on standard error, and asks what only they can do.

    Parameters
    ----------
    asks
        Whether the first motion waits for Enter.
    moves
        Whether a motor moves; a simulated one is reported only on a terminal.
    """

    def __init__(self, *, asks: bool, moves: bool) -> None:
        self._asks, self._moves = asks, moves
        self._shown = -_EVERY  # s on the computer's clock
        self._shows = sys.stderr.isatty() and not asked.quiet

    def begin(self, announcement: Sequence[str]) -> None:
        """Say what will be played, and wait for Enter."""
        for sentence in announcement:
            self._tell(sentence, even_if_quiet=self._asks)
        self._tell(
            "Ctrl-C ends it at any time: the drive is switched off, finished runs are kept, and "
            "the same command continues.",
            even_if_quiet=self._asks,
        )
        if self._asks:
            _await_enter(
                "Keep clear of the joint, with its supply switch within reach. Press Enter to "
                "begin: "
            )

    def phase(self, sentence: str) -> None:
        """Say what begins, or what came of it."""
        self._tell(sentence)

    def cycle(self, reading: Reading, command: float) -> None:
        """Show angle and command in one line that changes."""
        now = time.monotonic()
        if not self._shows or now - self._shown < _EVERY:
            return
        self._shown = now
        line = f"{reading.time:8.1f} s   angle {reading.angle:+8.3f} rad   command {command:+12.5f}"
        with suppress(OSError, ValueError):  # a lost or stopped terminal must not stop the motor
            if select.select([], [sys.stderr], [], 0)[1]:
                sys.stderr.write(_EMPTY + line[: shutil.get_terminal_size().columns - 1])
                sys.stderr.flush()

    def mount(self, mass: bf.AddedMass) -> None:
        """Ask a person to mount a mass, or to leave it on."""
        self.clear()
        wanted = str(mass) if mass.mass else "no added mass"
        _await_enter(
            f"The drive is off. The next run is with {wanted}: mount that, unless it is mounted; "
            "let the joint hang at rest, then press Enter: "
        )

    def clear(self) -> None:
        """Empty the line that changes."""
        if self._shows:
            with suppress(OSError):
                sys.stderr.write(_EMPTY)

    def _tell(self, sentence: str, *, even_if_quiet: bool = False) -> None:
        """Print a sentence on standard error, where somebody waits."""
        self.clear()
        if even_if_quiet or (not asked.quiet and (self._moves or self._shows)):
            put(_folded(sentence), file=sys.stderr)


def _folded(sentence: str) -> str:
    """Return a sentence folded between words, on a terminal."""
    if not sys.stderr.isatty():
        return sentence
    return "\n".join(textwrap.wrap(sentence, shutil.get_terminal_size().columns - 1))


def _await_enter(question: str) -> None:
    """Wait for Enter alone, pressed after the question."""
    try:
        while _answer(question).strip():
            pass
    except EOFError:
        raise StoppedError(
            "stopped: no answer at the keyboard; the drive is off, finished runs are kept, "
            "and the same command continues"
        ) from None


def _answer(question: str) -> str:
    """Return what is typed after a question, not what was typed before it."""
    if sys.stdin.isatty():
        try:
            import termios  # noqa: PLC0415 - not on every system

            termios.tcflush(sys.stdin, termios.TCIFLUSH)
        except (ImportError, OSError):
            pass
    lead, _, last = _folded(question).rpartition("\n")
    if lead:
        put(lead)
    return input(f"{visible(last.rstrip())} ")
