"""The folder of a campaign: a log of each run, their manifest, and a journal to go on from."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from butterfly.campaigns.bench import Recording
from butterfly.campaigns.contact import Contact
from butterfly.errors import InputError
from butterfly.files import finite, json_text, read_file, write_file
from butterfly.identification.data import DataSet, read_data_set
from butterfly.logs.log import InputKind, Intersample
from butterfly.logs.manifest import MANIFEST_NAME, LogEntry, Manifest, manifest_text, read_manifest
from butterfly.logs.parquet import parquet_bytes
from butterfly.model.parameters import AddedMass

JOURNAL = "campaign.json"
"""File of the journal."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """A run, and what was known after it."""

    what: str  # was played, in words
    kind: str = ""  # of it, such as are compared
    why: str
    added_mass: AddedMass
    seconds: float  # of robot time, up to its end
    cut: str = ""  # the limit that ended it early
    verdict: str = ""  # on the estimate after it; empty if there was none
    shares: dict[str, float] = field(default_factory=dict)  # of half-widths in what is wanted
    expected: float | None = None  # the largest of them, before the run
    misses: str = ""  # what the model misses, in words
    held_out: bool = False  # whether it was kept for the validation

    @property
    def largest(self) -> float:
        """Largest of the shares; infinite without an estimate."""
        return max(self.shares.values(), default=math.inf)


@dataclass(frozen=True, kw_only=True)
class Journal:
    """What was done so far."""

    input_kind: InputKind
    contact: Contact
    known: dict[str, Any] = field(default_factory=dict)
    steps: tuple[Step, ...] = ()

    @property
    def in_vain(self) -> list[Step]:
        """The last runs in a row that brought less than half of what was expected of them.

        That is of the way, in logarithms, from the smallest of the largest shares so far. The first
        with which the scale is no longer open is compared to nothing.
        """
        vain, least, scaled = list[Step](), math.inf, False
        for step in (step for step in self.steps if not step.held_out):
            if scaled != ("p1" in step.shares) and step.shares:
                least, scaled = math.inf, not scaled
            promised = least if step.expected is None else min(step.expected, least)
            if math.isinf(step.largest) or step.largest > math.sqrt(least * promised):
                vain.append(step)
            else:
                vain.clear()
            least = min(least, step.largest)
        return vain


_JOURNAL = TypeAdapter(Journal)


class Folder:
    """The files of a campaign; whatever was written before is kept."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._journal = self._read()

    @property
    def is_begun(self) -> bool:
        """Whether a campaign was begun here."""
        return self._journal is not None

    @property
    def journal(self) -> Journal:
        """What was done so far, of a campaign that was begun."""
        assert self._journal is not None  # noqa: S101 - see `is_begun`
        return self._journal

    def _read(self) -> Journal | None:
        """Return the journal of a campaign that was begun here, if any."""
        file = self.path / JOURNAL
        if not file.exists():
            if (self.path / MANIFEST_NAME).exists():
                expected = "a new folder, or that of a campaign: this one holds other logs"
                raise InputError(self.path, "folder", MANIFEST_NAME, expected)
            return None
        try:
            return _JOURNAL.validate_json(read_file(file, "a campaign's journal"))
        except ValidationError as error:
            raise InputError(file, "journal", str(error), "an undamaged journal") from None

    def begin(self, journal: Journal) -> None:
        """Begin a campaign, or take it up."""
        self.path.mkdir(parents=True, exist_ok=True)
        self._keep(journal)

    def add(self, run: Recording, step: Step) -> None:
        """Keep a run: its log first, then the manifest, then the journal."""
        steps = (*self.journal.steps, step)
        log = parquet_bytes(run.log(added_mass=step.added_mass))
        write_file(self.path / _file(len(steps) - 1), log)
        self._keep(replace(self.journal, steps=steps))

    def conclude(self, step: Step) -> None:
        """Say of the last run what was known after it."""
        self._keep(replace(self.journal, steps=(*self.journal.steps[:-1], step)))

    def data(self, only: int | None = None) -> DataSet:
        """Return the logs so far, or one of them, as `identify` reads them."""
        manifest = read_manifest(self.path / MANIFEST_NAME)
        one = {} if only is None else {"logs": [manifest.logs[only]], "holdout": []}
        return read_data_set(manifest.model_copy(update=one))

    def _keep(self, journal: Journal) -> None:
        self._journal = journal
        if journal.steps:
            manifest = manifest_text(_manifest(self.path.name, journal))
            write_file(self.path / MANIFEST_NAME, manifest, own=True)
        content = json_text(finite(_JOURNAL.dump_python(journal, mode="json")))
        write_file(self.path / JOURNAL, content, own=True)


def _file(number: int) -> str:
    return f"run_{number:03d}.parquet"


def _manifest(name: str, journal: Journal) -> Manifest:
    return Manifest(
        name=name,
        description="made by a campaign",
        input=journal.input_kind,
        intersample=Intersample.ZERO_ORDER_HOLD,
        sign=1 if journal.contact.polarity > 0 else -1,
        known=journal.known,
        holdout=[
            _file(k).removesuffix(".parquet") for k, s in enumerate(journal.steps) if s.held_out
        ],
        logs=[LogEntry.of(_file(k), step.added_mass) for k, step in enumerate(journal.steps)],
    )
