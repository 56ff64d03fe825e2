"""Files: valid names, shipped files, and writing whole files or nothing."""

from __future__ import annotations

import hashlib
import json
import math
import re
import secrets
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from zipfile import ZipFile

from butterfly import outputs
from butterfly.errors import ButterflyError, InputError, nearest, size_text

_PACKAGE = Path(__file__).parent
_ROOTS = (_PACKAGE / "_shipped", _PACKAGE.parent)  # of shipped files: in a wheel, in a checkout

DRAFT = ".draft-"
"""Prefix of the names of unfinished files."""


SIGNATURE = "digest"
"""Key of a document with the digest of the rest of its file."""

LONGEST_NAME = 100
"""Characters allowed in the name of a folder's content, to which more is added."""

_RESERVED = re.compile(r"\.+|(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
_LONGEST = 255  # bytes of a name, on all file systems that matter
_LONGEST_PATH = 4096

_PACKED = 64  # times its size that a file of logs may expand to
_FREE = 256 << 20  # bytes that any file may
_KINDS: dict[Any, tuple[str, str]] = {  # how files begin, what they are, what to give instead
    b"PK\3\4": ("a zip file", "a name ending in .xlsx or .npz for Excel's or NumPy's, or CSV"),
    b"\x93NUMPY": ("an array of NumPy's", "a name ending in .npy"),
    b"PAR1\x15": ("a Parquet file", "a name ending in .parquet"),
    b"\x89MCAP": ("an MCAP file", "a name ending in .mcap"),
    (b"MATLAB 5.0 MAT", b"MATLAB 7.3 MAT"): ("a MATLAB file", "a name ending in .mat"),
    b"\xd0\xcf\x11\xe0": ("an Excel file of before 2007", "it saved as .xlsx or CSV"),
    (b"\x1f\x8b", b"BZh9", b"\xfd7zXZ", b"(\xb5/\xfd"): ("a packed file", "it unpacked"),
    b"\x89HDF": ("an HDF5 file", "CSV (Python: h5py.File, numpy.savetxt)"),
    b"ARROW1\0": ("an Arrow or Feather file", "CSV (pandas.read_feather(...).to_csv)"),
    b"WPILOG\0": ("a WPILib data log", "CSV (AdvantageScope: File, Export Data)"),
    b"#ROSBAG V": ("a ROS 1 bag", "CSV (rostopic echo -b FILE -p TOPIC > log.csv)"),
    b"SQLite format 3\0": ("an SQLite database, as of ROS 2", "MCAP (ros2 bag convert), or CSV"),
    b"MDF     ": ("an MDF measurement", "CSV (asammdf: Export)"),
    b"TDSm": ("a TDMS file", "CSV (nptdms.TdmsFile.read(...).as_dataframe().to_csv)"),
    b"ULog\1": ("a ULog of PX4", "CSV (pyulog: ulog2csv)"),
    b"\xa3\x95\x80": ("a log of ArduPilot", "CSV (pymavlink: mavlogdump.py --format csv)"),
    b"\x80\4\x95": ("a Python pickle, which may run any code", "CSV, where it was made"),
    (b"\x89PNG", b"\xff\xd8\xff", b"%PDF-"): ("a picture", "the numbers in it, as CSV"),
}


def is_name(text: str) -> bool:
    """Whether a text may name a folder: short, not only dots, not a Windows device."""
    return len(text) <= LONGEST_NAME and _RESERVED.fullmatch(text) is None


def require_path(named: str, source: object, field: str) -> None:
    """Raise InputError for a text, in a field of a source, that cannot be a path."""
    parts = [part.encode(errors="surrogatepass") for part in named.replace("\\", "/").split("/")]
    longest = max(map(len, parts))
    if "\0" in named:
        raise InputError(source, field, repr(named[:40]), "a path without null characters")
    if longest > _LONGEST or len(named) > _LONGEST_PATH:
        excerpt = f"{named[:40]}... ({len(named)} characters)"
        raise InputError(source, field, excerpt, f"a path with names of at most {_LONGEST} bytes")


def most_in(packed: int) -> int:
    """Return how many bytes a compressed file may expand to: more is damage, or worse."""
    return max(_FREE, _PACKED * packed)


@contextmanager
def replacing(path: Path, mark: str = "", *, internal: bool = False) -> Iterator[Path]:
    """Yield a temporary path beside ``path`` that takes its name when the block succeeds.

    The temporary name is unique, so several processes may write one path: the last one wins. It has
    the ending of ``path``, for writers that need it. The block creates the file, with the usual
    permissions, and with its ``mark`` if any (see `butterfly.outputs`). InputError if it cannot be
    written or may not, unless the path is the program's own (``internal``).
    """
    if not internal:
        outputs.require_free(path, mark)
    draft = path.with_name(f"{DRAFT}{secrets.token_hex(8)}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield draft
        draft.replace(path)
    except OSError as error:
        raise InputError(path, "path", error.strerror or error, "a writable file") from None
    finally:
        with suppress(OSError):
            draft.unlink()


def require_file(path: Path, expected: str) -> int:
    """Return the size of a regular file; InputError, with ``expected``, for anything else.

    A pipe or a device has no end to wait for.
    """
    require_path(str(path), path, "path")
    try:
        status = path.stat()
        if stat.S_ISREG(status.st_mode):
            path.open("rb").close()
            outputs.note_input(path)
            return status.st_size
    except FileNotFoundError:
        raise InputError(path, "path", "no such file", expected) from None
    except OSError as error:
        raise InputError(path, "path", error.strerror or error, "a readable file") from None
    kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe or a device"
    raise InputError(path, "path", kind, expected)


def read_file(path: Path, expected: str, most: float = math.inf) -> bytes:
    """Read a regular file of at most ``most`` bytes; else InputError, with ``expected``."""
    size = require_file(path, expected)
    if size > most:
        most_text = f"{expected} of at most {size_text(most)}"
        raise InputError(path, "content", size_text(size), most_text)
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(path, "path", error.strerror or error, "a readable file") from None


def write_file(path: Path, content: str | bytes, mark: str = "", *, internal: bool = False) -> None:
    """Write a file whole or not at all, a text as UTF-8 (see `replacing`)."""
    with replacing(path, mark, internal=internal) as draft:
        draft.write_bytes(content.encode() if isinstance(content, str) else content)


def create_file(path: Path, content: bytes) -> None:
    """Write a new file whole or not at all; InputError if anything has its name, a link too."""
    created = False
    try:
        with path.open("xb") as file:
            created = True
            file.write(content)
    except BaseException as error:
        if created:
            with suppress(OSError):
                path.unlink()
        if isinstance(error, FileExistsError):
            raise InputError(path, "path", "an existing file", "a new path") from None
        if isinstance(error, OSError):
            raise InputError(path, "path", error.strerror or error, "a writable file") from None
        raise


def write_xml(path: Path, content: str, kind: str) -> None:
    """Write an XML file of a kind, its mark as a comment at the end."""
    mark = outputs.mark_of(path, kind)
    write_file(path, f"{content.rstrip()}\n{mark}\n", mark)


@contextmanager
def whole(path: Path, expected: str, *, trusting: bool = False) -> Iterator[None]:
    """Turn what a reader raises on damage into InputError; lack of memory only if ``trusting``."""
    try:
        yield
    except ButterflyError:
        raise
    except Exception as error:
        if isinstance(error, MemoryError) and not trusting:
            raise
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(path, "content", f"unreadable ({reason})", expected) from None


@contextmanager
def unpacked(path: Path, expected: str) -> Iterator[ZipFile]:
    """Yield a zip file of parts of a sane size; damage is InputError, with ``expected``."""
    most = most_in(require_file(path, expected))
    with whole(path, expected), ZipFile(path) as parts:
        size = sum(max(part.file_size, part.compress_size) for part in parts.infolist())
        if size > most:
            raise InputError(path, "content", f"parts of {size_text(size)}", expected)
        yield parts


def refuse_binary(path: Path, *, any_kind: bool = True) -> None:
    """Raise InputError for a file that begins as one of ``_KINDS``, or of ``any_kind`` of bytes."""
    head = b""
    with suppress(OSError, ValueError):  # whoever reads it says what is wrong
        if path.is_file():
            with path.open("rb") as file:
                head = file.read(256)
    for beginning, (kind, instead) in _KINDS.items():
        if head.startswith(beginning):
            raise InputError(path, "content", kind, instead)
    if any_kind and b"\0" in head:
        data = f"binary data that begin with {head[:8].hex(' ')}"
        raise InputError(path, "content", data, "CSV, exported by what wrote them")


def finite(value: Any) -> Any:  # noqa: ANN401 - any JSON
    """Replace numbers that JSON cannot represent by null."""
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def json_text(content: Mapping[str, Any], *, ascii_only: bool = False) -> str:
    """Return a document as text, with escapes for other letters for what cannot take them."""
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=ascii_only) + "\n"


def write_document(content: Mapping[str, Any], path: Path, *, sign: bool = False) -> None:
    """Write a document to a .json file, signed if wanted; InputError if it cannot be written."""
    outputs.require_endings(path, (".json",))
    kind, second = content.get("schema", ""), [*content, "", ""][1]
    mark = outputs.mark_of_document(kind.removeprefix("butterfly."), second) if kind else ""
    document = finite(content)
    text = signed(json_text({**document, SIGNATURE: ""})) if sign else json_text(document)
    write_file(path, text, mark)


def digest_of(content: bytes) -> str:
    """Return the digest of a content."""
    return hashlib.sha256(content).hexdigest()


def signed(text: str) -> str:
    """Return a JSON text with the digest of it, which reveals damage, in its empty ``digest``."""
    before, _, after = text.rpartition(_signature(""))
    return f"{before}{_signature(digest_of(text.encode()))}{after}"


def is_as_signed(text: str, digest: str) -> bool:
    """Whether a JSON text with a digest is what was signed."""
    before, _, after = text.rpartition(_signature(digest))
    return digest == digest_of(f"{before}{_signature('')}{after}".encode())


def _signature(digest: str) -> str:
    return f'"{SIGNATURE}": "{digest}"'


def require_as_signed(path: Path, text: str, content: dict[str, Any], expected: str) -> None:
    """Take the digest out of a document; InputError if the file is not what was signed."""
    digest = content.pop(SIGNATURE, None)
    if digest is not None and not (isinstance(digest, str) and is_as_signed(text, digest)):
        raise InputError(path, SIGNATURE, "another content than was written", expected)


def shipped(relative: str | Path) -> Path:
    """Return the path of a shipped file such as ``models/butterfly_hand/hand.xml``."""
    for root in _ROOTS:
        candidate = root / relative
        if candidate.exists():
            return candidate
    raise InputError(
        relative, "path", "no such shipped file", "a file under models/ or experiments/"
    )


def shipped_experiments() -> list[str]:
    """List the shipped experiment and data-set files, as ``experiments/.../NAME.yaml``."""
    root = shipped("experiments")
    return sorted(
        f"experiments/{path.relative_to(root).as_posix()}" for path in root.rglob("*.yaml")
    )


def locate(path: Path) -> Path:
    """Resolve a path as given, else a shipped file of that name or stem."""
    require_path(str(path), "data", "path")
    if path.exists():
        return path
    for name in shipped_experiments():
        if str(path) in {name, Path(name).name, Path(name).stem}:
            return shipped(name)
    expected = "an existing path"
    if path.suffix.lower() in {"", ".yaml", ".yml"}:
        stems = [Path(name).stem for name in shipped_experiments()]
        expected += f", or a shipped file: {nearest(path.stem, stems)}"
    raise InputError(path, "path", "no such file or folder", expected)
