"""Write files so that a reader, or a killed run, never meets half of one."""

from __future__ import annotations

from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from butterfly.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


DRAFT = ".draft-"
"""How the names of files begin that were not finished."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside ``path`` that takes its name when the block succeeds.

    Raises
    ------
    InputError
        If the folder cannot be made or written to.
    """
    draft = path.with_name(f"{DRAFT}{path.name}.part{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield draft
        draft.replace(path)
    except OSError as error:
        raise InputError(
            path, "path", error.strerror or error, "a file that can be written"
        ) from None
    finally:
        with suppress(OSError):
            draft.unlink()
