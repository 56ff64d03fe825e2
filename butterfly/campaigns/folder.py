"""The folder of a campaign: a log of each run, their manifest, and a journal to continue from."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from shutil import disk_usage
from typing import Any

from pydantic import TypeAdapter, ValidationError

from butterfly.campaigns.bench import Contact, Recording
from butterfly.campaigns.lock import LOCK, locked
from butterfly.errors import InputError, listed, size_text
from butterfly.files import (
    DRAFT,
    SIGNATURE,
    create_file,
    digest_of,
    finite,
    json_text,
    read_file,
    require_as_signed,
    require_path,
    signed,
    write_file,
)
from butterfly.identification.data import DataSet, read_data_set
from butterfly.logs.log import InputKind, Intersample
from butterfly.logs.manifest import (
    MANIFEST_NAME,
    LogEntry,
    Manifest,
    manifest_text,
    own_units,
    read_manifest,
)
from butterfly.logs.parquet import parquet_bytes
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import Prior, plain
from butterfly.outputs import mark_of, mark_of_document, require_free
from butterfly.yaml_files import refusal

JOURNAL = "campaign.json"
"""File of the journal."""

PAGE = "report.html"
"""File of the report, its numbers beside it."""


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
    is_sound: bool = False  # whether it was checked, and nothing was wrong

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
    of_model: dict[str, Any] = field(default_factory=dict)  # manifest's fields, by a robot's model
    steps: tuple[Step, ...] = ()
    logs: tuple[str, ...] = ()  # SHA-256 of the file of each run

    @property
    def in_vain(self) -> list[Step]:
        """The last runs in a row that brought less than half of what was expected of them.

        A run is judged by its largest share: on a logarithmic scale, it went less than half of the
        way from the smallest so far to the expected one. The first run after the scale is known is
        compared to nothing.
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
_KIND, _VERSION = "butterfly.journal", 2  # of the document; the number grows with its fields
_ROOM = 10e6  # bytes of free space: ten minutes at 500 Hz, three numbers a sample, and a page


class Folder:
    """The files of a campaign, from which it can continue; a context that locks out other writers.

    It is new, empty, or a campaign's own, which its journal marks. A log is never replaced.

    Parameters
    ----------
    path
        The folder; a link is followed once.
    """

    def __init__(self, path: Path) -> None:
        require_path(str(path), "campaign", "out")
        self.path = _resolved(path)
        self.notes: list[str] = []
        """Sentences on what an earlier campaign left behind, and what became of it."""
        self._journal: Journal | None = None
        self._held = ExitStack()

    def __enter__(self) -> Folder:
        with ExitStack() as held:
            self._require_own()
            held.enter_context(_made(self.path))
            former = held.enter_context(locked(self.path / LOCK))
            self._require_own()  # what may have come since
            self._require_room()
            self._journal = self._read()
            if former is not None:
                self.notes.append(
                    f"An earlier campaign in {self.path.name} was killed ({former}): its lock is "
                    "taken over."
                )
            self._keep_unlisted()
            self._held = held.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._held.close()

    @property
    def is_begun(self) -> bool:
        """Whether a campaign was begun here."""
        return self._journal is not None

    @property
    def journal(self) -> Journal:
        """What was done so far, of a campaign that was begun."""
        assert self._journal is not None  # noqa: S101 - see `is_begun`
        return self._journal

    def begin(self, journal: Journal) -> None:
        """Begin a campaign, or take it up."""
        known = {name: plain(value) for name, value in Prior.of(journal.known).values.items()}
        self._write_journal(replace(journal, known=known))  # as a manifest spells them, too
        self._write_manifest()

    def add(self, run: Recording, step: Step) -> None:
        """Keep a run: its log first, then the journal, then the manifest."""
        steps, log = self.journal.steps, parquet_bytes(run.log(added_mass=step.added_mass))
        self._keep_unlisted()  # whatever took the name while it was recorded
        create_file(self.path / log_name(len(steps)), log)
        logs = (*self.journal.logs, digest_of(log))
        self._write_journal(replace(self.journal, steps=(*steps, step), logs=logs))
        self._write_manifest()

    def conclude(self, step: Step) -> None:
        """Say of the last run what was known after it."""
        self._write_journal(replace(self.journal, steps=(*self.journal.steps[:-1], step)))

    def withdraw(self) -> None:
        """Take the last run out of the journal; its log is kept beside, under another name."""
        *steps, _ = self.journal.steps
        self._write_journal(
            replace(self.journal, steps=tuple(steps), logs=self.journal.logs[: len(steps)])
        )
        self._write_manifest()
        self._keep_unlisted()

    def set_aside(self, run: Recording, step: Step) -> None:
        """Keep a run that is not to be used beside the others, where it makes a log."""
        with suppress(InputError):  # such as of a joint that diverged
            log = parquet_bytes(run.log(added_mass=step.added_mass))
            create_file(_unlisted_path(self.path / log_name(len(self.journal.steps))), log)

    def data(self, runs: slice | None = None) -> DataSet:
        """Return the logs so far, or of some of the runs, as `identify` reads them."""
        manifest = self._manifest(self.journal)
        some = {} if runs is None else {"logs": manifest.logs[runs], "holdout": []}
        return read_data_set(manifest.model_copy(update=some))

    def _require_own(self) -> None:
        """Raise InputError unless the folder may be used, and all that is replaced may be."""
        try:
            names = sorted(path.name for path in self.path.iterdir())
        except FileNotFoundError:
            return
        except NotADirectoryError:
            raise InputError(self.path, "out", "a file", "a folder") from None
        except OSError as error:
            raise InputError(self.path, "out", error.strerror, "a readable folder") from None
        there = [name for name in names if not name.startswith((LOCK, DRAFT))]
        if there and JOURNAL not in there:
            expected = f"a new or empty folder, or a campaign's, which has a {JOURNAL}"
            raise InputError(self.path, "out", f"a folder with {listed(there)}", expected)
        for name in (JOURNAL, MANIFEST_NAME):
            if (self.path / name).is_symlink():
                raise InputError(self.path / name, "path", "a link", "a file of its own")
        page = self.path / PAGE
        numbers = page.with_suffix(".json")
        require_free(page, mark_of(page, "campaign"))
        require_free(numbers, mark_of_document("campaign"))

    def _require_room(self) -> None:
        """Raise InputError if the disk has no room for the logs of a campaign."""
        free = disk_usage(self.path).free
        if free < _ROOM:
            raise InputError(self.path, "free space", size_text(free), f"{size_text(_ROOM)} of it")

    def _read(self) -> Journal | None:
        """Return the journal of a campaign that was begun here, if any, with sound files."""
        file = self.path / JOURNAL
        if not file.exists():
            return None
        journal = _read_journal(file)
        for number, digest in enumerate(journal.logs):
            log = self.path / log_name(number)
            expected = f"the log of run {number} as it was recorded, which {JOURNAL} lists"
            if digest_of(read_file(log, expected)) != digest:
                raise InputError(log, "content", "another file", expected)
        self._require_manifest(journal)
        return journal

    def _require_manifest(self, journal: Journal) -> None:
        """Raise InputError if the manifest is not that of the journal, or of the one before it.

        After a kill it may lack the last run, and known values that were given later.
        """
        file, steps = self.path / MANIFEST_NAME, journal.steps
        if not file.exists():
            return
        expected = f"what {JOURNAL} lists; remove {MANIFEST_NAME}, and it is written again"
        if not steps:
            raise InputError(file, "path", "a manifest", f"none: {JOURNAL} lists no run")
        manifest = read_manifest(file)
        behind = [some for some in (steps, steps[:-1]) if some]
        differing = [
            _differing(manifest, self._manifest(replace(journal, steps=s))) for s in behind
        ]
        if all(differing):
            field = differing[0][0]
            raise InputError(file, field, "another content", expected)

    def _keep_unlisted(self) -> None:
        """Rename logs that no journal lists, such as a kill leaves, so that none is replaced."""
        begun = 0 if self._journal is None else len(self._journal.steps)
        for path in sorted(self.path.glob("run_*.parquet")):
            number = path.stem.removeprefix("run_")
            if number.isdecimal() and int(number) >= begun and path.name == log_name(int(number)):
                target = _unlisted_path(path)
                try:
                    path.rename(target)
                except OSError as error:
                    expected = f"a file that can be renamed, as {JOURNAL} does not list it"
                    raise InputError(path, "path", error.strerror, expected) from None
                self.notes.append(
                    f"{path.name} is not in {JOURNAL}: it is kept as {target.name}, and not used."
                )

    def _manifest(self, journal: Journal) -> Manifest:
        """Return the manifest of a journal with runs."""
        runs = [(log_name(k), step) for k, step in enumerate(journal.steps)]
        return Manifest(
            name=self.path.name,
            description="made by a campaign",
            root=str(self.path),
            input=journal.input_kind,
            units=own_units(journal.input_kind),
            intersample=Intersample.ZERO_ORDER_HOLD,
            sign=1 if journal.contact.polarity > 0 else -1,
            known=journal.known,
            holdout=[Path(name).stem for name, step in runs if step.held_out],
            logs=[LogEntry.carrying(name, step.added_mass) for name, step in runs],
            **journal.of_model,
        )

    def _write_manifest(self) -> None:
        if self.journal.steps:
            manifest = self._manifest(self.journal).model_copy(update={"root": "."})
            write_file(self.path / MANIFEST_NAME, manifest_text(manifest), internal=True)

    def _write_journal(self, journal: Journal) -> None:
        head = {"schema": _KIND, "schema_number": _VERSION}
        content = finite(head | _JOURNAL.dump_python(journal, mode="json"))
        write_file(self.path / JOURNAL, signed(json_text(content | {SIGNATURE: ""})), internal=True)
        self._journal = journal


def _resolved(path: Path) -> Path:
    """Return the folder of a path, links followed."""
    try:
        return path.resolve()
    except (OSError, RuntimeError):  # links in a circle, of which Python 3.13 says nothing
        raise InputError(path, "out", "a link to itself", "a folder") from None


@contextmanager
def _made(path: Path) -> Iterator[None]:
    """Make a folder that does not exist; remove it after the block if nothing is in it."""
    new = not path.exists()
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(path, "out", error.strerror, "a folder that can be written") from None
    try:
        yield
    finally:
        if new:
            with suppress(OSError):
                path.rmdir()


def _read_journal(file: Path) -> Journal:
    """Return the journal in a file; InputError if it is damaged, or not of this version."""
    text = read_file(file, "a campaign's journal")
    expected = "an undamaged journal of a campaign; restore it, or begin in a new folder"
    try:
        content = json.loads(text)
        kind, number = content.get("schema"), content.get("schema_number")
    except (ValueError, AttributeError, RecursionError):
        raise InputError(file, "content", "no JSON object", expected) from None
    if kind != _KIND:
        raise InputError(file, "schema", kind, f"{_KIND}: no campaign was begun here")
    if number != _VERSION:
        remedy = f"{_VERSION}; continue with the version that began it, or begin in a new folder"
        raise InputError(file, "schema_number", number, remedy)
    try:
        journal = _JOURNAL.validate_json(text)
    except ValidationError as error:
        raise refusal(error, file, whole=expected, content=content) from None
    Prior.of(journal.known, file)
    if len(journal.logs) != len(journal.steps):
        counts = f"{len(journal.logs)} for {len(journal.steps)} runs"
        raise InputError(file, "logs", counts, expected)
    content.setdefault(SIGNATURE, "")  # which no journal is without
    require_as_signed(file, text.decode(), content, expected)
    return journal


def _differing(manifest: Manifest, ours: Manifest) -> list[str]:
    """Return the fields in which a manifest differs from one that is written here.

    A folder may be renamed, and known values may have been added since.
    """
    theirs, written = manifest.model_dump(), ours.model_dump()
    known = theirs["known"].items() <= written["known"].items()
    free = {"name", "description"} | ({"known"} if known else set())
    return [name for name in written if name not in free and theirs[name] != written[name]]


def _unlisted_path(path: Path) -> Path:
    """Return a free path beside a log, for one that no journal lists."""
    there = {file.name for file in path.parent.iterdir()}
    stems = (f"{path.stem}.unlisted{f'_{n}' if n > 1 else ''}" for n in itertools.count(1))
    return next(place for place in map(path.with_stem, stems) if place.name not in there)


def log_name(number: int) -> str:
    """Return the name of a run's log."""
    return f"run_{number:03d}.parquet"
