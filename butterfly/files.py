"""Write files so that a reader, or a killed run, never meets half of one."""

from __future__ import annotations

import secrets
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

    The temporary name is nobody else's, so that several processes may write one path: the last
    that is done wins. It ends as ``path`` does, for writers that look at it. The file is for the
    block to make, with the permissions that a new file gets.

    Raises
    ------
    InputError
        If the folder cannot be made or written to.
    """
    draft = path.with_name(f"{DRAFT}{secrets.token_hex(8)}{path.suffix}")
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
