"""Who is told what a campaign does, while it moves a joint."""

from __future__ import annotations

from collections.abc import Sequence

from butterfly.plant.motor import Reading


class Observer:
    """Is told each phase and shown each cycle; this one says nothing. Any method may be replaced.

    What a method raises ends the campaign, with the drive off.
    """

    def begin(self, announcement: Sequence[str]) -> None:
        """Take what will be played, the limits and how to stop it, before the first motion."""

    def phase(self, sentence: str) -> None:
        """Take a sentence on what begins now and why, or on what came of it."""

    def cycle(self, reading: Reading, command: float) -> None:
        """Take a reading, and the command that was set after it."""


SILENT = Observer()
