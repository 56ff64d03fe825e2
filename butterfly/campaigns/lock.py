"""One campaign at a time in a folder: a lock file that names the process that holds it.

A process that was killed leaves its lock. It is stale if that process is gone, or another one has
its number by now, and may be taken. Of several processes that would take it at once one does: it
alone holds a second lock, beside the first, while it replaces it. That one may be left by a kill,
too, and is then taken in the same way.
"""

from __future__ import annotations

import os
import secrets
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from pydantic import PositiveInt, TypeAdapter, ValidationError

from butterfly.errors import InputError
from butterfly.files import DRAFT

LOCK = "campaign.lock"
"""Name of the lock, and beginning of the names of what is needed to take it."""

_LONGEST = 4096  # bytes that are read of a lock; a whole one has a tenth
_ENDED = {b"Z", b"X"}  # states of a process that runs no more, though nobody has asked how it ended


@dataclass(frozen=True)
class Holder:
    """The process that holds a lock."""

    host: str
    process: PositiveInt
    started: int | None = None  # clock ticks after boot, where the system gives them

    @classmethod
    def here(cls) -> Holder:
        """Return this process."""
        state = _state(os.getpid())
        return cls(socket.gethostname(), os.getpid(), None if state is None else state[1])

    @property
    def is_here(self) -> bool:
        """Whether this machine can say if the process runs."""
        return self.host == socket.gethostname() and os.name == "posix"

    @property
    def is_gone(self) -> bool:
        """Whether the process is known to run no more."""
        if not self.is_here:
            return False
        try:
            os.kill(self.process, 0)  # asks whether it is there, and sends nothing
        except ProcessLookupError:
            return True
        except (PermissionError, OverflowError):  # of another user
            pass
        state = _state(self.process)
        if state is None:
            return False
        return state[0] in _ENDED or self.started not in {None, state[1]}

    def __str__(self) -> str:
        return f"process {self.process} on {self.host}"


_HOLDER = TypeAdapter(Holder)


@contextmanager
def locked(path: Path) -> Iterator[Holder | None]:
    """Hold a lock file in a block; yield the former holder, if it is gone and left the lock.

    InputError if another process holds the lock, or the file cannot be written.
    """
    former = _take(path)
    try:
        yield former
    finally:
        with suppress(OSError, InputError):
            if holder_of(path) == Holder.here():  # not that of who took it after it was removed
                path.unlink()


def _take(path: Path) -> Holder | None:
    """Take a lock, and return its former holder if it was stale."""
    while not _created(path):
        holder = holder_of(path)
        if holder is None:  # it was released just now
            continue
        if not holder.is_gone:
            expected = "its end, or another folder"
            if not holder.is_here:
                expected += f"; if no campaign runs there, remove {path.name}"
            raise InputError(path.parent, "out", f"a campaign of {holder} in it", expected)
        with locked(path.with_name(f"{path.name}.taken")):
            if holder_of(path) == holder:  # nobody else can replace it now
                _replace(path)
                return holder
    return None


def _created(path: Path) -> bool:
    """Return whether the lock was made for this process: not if there is one.

    It gets its name with its content in it, so nobody reads half of it.
    """
    with _draft(path) as draft:
        try:
            path.hardlink_to(draft)
        except FileExistsError:
            return False
        except OSError:  # a file system without hard links
            try:
                with path.open("xb") as file:
                    file.write(draft.read_bytes())
            except FileExistsError:
                return False
    return True


def _replace(path: Path) -> None:
    """Put the lock of this process in the place of another."""
    with _draft(path) as draft:
        draft.replace(path)


@contextmanager
def _draft(path: Path) -> Iterator[Path]:
    """Yield a file beside the lock that names this process; InputError if none can be written."""
    draft = path.with_name(f"{DRAFT}{secrets.token_hex(8)}{path.suffix}")
    try:
        draft.write_bytes(_HOLDER.dump_json(Holder.here()))
        yield draft
    except OSError as error:
        reason = error.strerror or error
        raise InputError(path.parent, "out", reason, "a folder that can be written") from None
    finally:
        with suppress(OSError):
            draft.unlink()


def holder_of(path: Path) -> Holder | None:
    """Return who holds a lock; None if nobody does."""
    remedy = f"the lock of a campaign; if none runs in {path.parent}, remove this file"
    if path.is_symlink():
        raise InputError(path, "path", "a link", remedy)
    try:
        with path.open("rb") as file:
            return _HOLDER.validate_json(file.read(_LONGEST))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(path, "path", error.strerror or error, remedy) from None
    except ValidationError:
        raise InputError(path, "content", "no host and process", remedy) from None


def _state(process: int) -> tuple[bytes, int] | None:
    """Return state and start of a process, fields 3 and 22 of its ``stat``; None if not given."""
    try:
        text = Path(f"/proc/{process}/stat").read_bytes()
    except OSError:
        return None
    fields = text.rpartition(b")")[2].split()  # its name, in brackets, may hold anything
    return fields[0], int(fields[19])
