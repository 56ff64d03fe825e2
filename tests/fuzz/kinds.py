"""The kinds of files that are damaged: what they are when sound, and how they are read."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from scipy.io import savemat

from tests.fuzz import mat, text

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


def _written(content: dict[str, object], *, packed: bool) -> bytes:
    file = io.BytesIO()
    savemat(file, content, do_compression=packed)
    return file.getvalue()


MATS = [_written(each, packed=packed) for each in mat.CONTENTS.values() for packed in (False, True)]

KINDS: dict[str, tuple[list[bytes], Callable[[bytes, Path], str]]] = {
    "mat": (MATS, mat.escapes),
    "csv": (text.CSV, text.csv_escapes),
    "experiment": (text.EXPERIMENTS, text.experiment_escapes),
    "manifest": (text.MANIFESTS, text.manifest_escapes),
}
"""Sound contents, and what tells what escapes of one that is not, by the kind."""
