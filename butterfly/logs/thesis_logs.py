"""The thesis's 41 public logs: names and checksums, their folder, and fetching them."""

from __future__ import annotations

import hashlib
import os
import time
from concurrent.futures import Future
from functools import cache
from pathlib import Path
from threading import Event, Thread
from typing import NamedTuple

from butterfly.errors import InputError
from butterfly.files import read_file, write_file
from butterfly.progress import Track, untracked

VARIABLE = "BUTTERFLY_LOGS"
"""Environment variable that names the folder of the logs."""

PUBLISHED = (
    "https://raw.githubusercontent.com/ArtemShiryaev/Thesis_Butterfly_Robot/"
    "526ea3e8c935dbf9ddb44766e5477903089a4b32"
)
"""Public address of the logs."""

_AT_ONCE = 4
_TIMEOUT = 30.0  # s in which a server must answer, and then send more
_DEADLINE = 1800.0  # s for all logs
_PART = 1 << 16  # bytes read at a time, at most
_GOES_ON = (
    "a log; the logs fetched so far are kept: repeat the command to continue, or use --from "
    "with a folder or another address"
)
_ADDRESSES = ("http://", "https://")


class Pin(NamedTuple):
    """Checksum and size of a log."""

    sha256: str
    size: int  # bytes


@cache
def pins() -> dict[str, Pin]:
    """Return checksum and size of each log, by its path in the folder."""
    lines = Path(__file__).with_name("thesis_logs.txt").read_text(encoding="utf-8").splitlines()
    return {name: Pin(digest, int(size)) for digest, size, name in map(str.split, lines)}


def own_folder() -> Path:
    """Return the user's folder for fetched logs."""
    from platformdirs import user_data_path  # noqa: PLC0415 - slow to import

    return user_data_path("butterfly-testbed", appauthor=False) / "thesis-logs"


def found_folder() -> Path | None:
    """Return the folder that `VARIABLE` names, else the user's own if it holds all logs."""
    if named := os.environ.get(VARIABLE):
        return Path(named)
    folder = own_folder()
    return folder if all((folder / name).is_file() for name in pins()) else None


def fetch(folder: Path, source: str = PUBLISHED, track: Track = untracked) -> int:
    """Fetch a folder's missing logs from another folder or an address, checked; return how many."""
    if not source.startswith(_ADDRESSES) and not Path(source).is_dir():
        expected = f"an existing folder, or an address that begins with {' or '.join(_ADDRESSES)}"
        raise InputError("logs fetch", "--from", source, expected)
    waiting = {name: Future[bytes]() for name in pins() if not _is_there(folder, name)}
    count = len(waiting)
    queue, stop, end = iter(list(waiting.items())), Event(), time.monotonic() + _DEADLINE

    def bring() -> None:
        for name, future in queue:
            if stop.is_set():
                break
            try:
                future.set_result(_content(f"{source.rstrip('/')}/{name}", pins()[name], stop))
            except Exception as error:
                future.set_exception(error)
                break  # which ends all, as soon as it is read

    for _ in range(_AT_ONCE):  # an executor would wait for its threads at the end
        Thread(target=bring, daemon=True).start()
    try:
        for name in track(list(waiting), "Fetching logs"):
            write_file(folder / name, waiting.pop(name).result(max(end - time.monotonic(), 0.0)))
    except TimeoutError:
        missing = f"{len(waiting) + 1} logs still missing after {_DEADLINE:g} s"
        raise InputError(source, "transfer", missing, _GOES_ON) from None
    finally:
        stop.set()
    return count


def _is_there(folder: Path, name: str) -> bool:
    """Whether a folder has a log; another file of its name is refused."""
    path = folder / name
    if not path.exists():
        return False
    else_none = "or no file (it is not overwritten)"
    content = read_file(path, f"the log of this name, {else_none}", most=pins()[name].size)
    _require(pins()[name], content, path, else_none)
    return True


def _content(origin: str, pin: Pin, stop: Event) -> bytes:
    """Return the content of a log at its origin."""
    if origin.startswith(_ADDRESSES):
        content = _downloaded(origin, pin.size, stop)
    else:
        content = read_file(Path(origin), "a log to copy", most=pin.size)
    _require(pin, content, origin, "that of the log of this name")
    return content


def _require(pin: Pin, content: bytes, source: object, more: str) -> None:
    digest = hashlib.sha256(content).hexdigest()
    if digest != pin.sha256:
        raise InputError(source, "SHA-256", digest, f"{pin.sha256}, {more}")


def _downloaded(address: str, size: int, stop: Event) -> bytes:
    """Return what an address sends, at most ``size`` bytes."""
    import requests  # noqa: PLC0415 - slow to import
    from urllib3.exceptions import HTTPError  # noqa: PLC0415

    content = bytearray()
    try:
        with requests.get(address, stream=True, timeout=_TIMEOUT) as response:
            response.raise_for_status()
            while part := response.raw.read1(_PART, decode_content=True):
                content += part
                if stop.is_set():
                    break
                if len(content) > size:
                    raise InputError(address, "transfer", f"more than {size} bytes", "the log")
    except (requests.RequestException, HTTPError) as error:
        raise InputError(address, "transfer", _why(error), _GOES_ON) from None
    return bytes(content)


def _why(error: BaseException) -> object:
    """Return the root cause of a failed transfer."""
    if (response := getattr(error, "response", None)) is not None:
        return f"{response.status_code} {response.reason}"
    while (cause := error.__cause__ or error.__context__) is not None:
        error = cause
    if isinstance(error, TimeoutError):
        return f"no answer within {_TIMEOUT:g} s"
    return getattr(error, "strerror", None) or error
