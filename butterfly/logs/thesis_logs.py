"""The thesis's 41 public logs: which they are, where they lie, and how they are fetched."""

from __future__ import annotations

import hashlib
import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

from butterfly.errors import InputError
from butterfly.files import read_file, replacing
from butterfly.progress import Track, untracked

VARIABLE = "BUTTERFLY_LOGS"
"""Environment variable that names the folder of the logs."""

PUBLISHED = (
    "https://raw.githubusercontent.com/ArtemShiryaev/Thesis_Butterfly_Robot/"
    "526ea3e8c935dbf9ddb44766e5477903089a4b32"
)
"""Where the logs are public."""

_AT_ONCE = 4
_TIMEOUT = 30.0  # s in which a server must answer, and send more once it has begun
_ADDRESSES = ("http://", "https://")


@cache
def digests() -> dict[str, str]:
    """Return the SHA-256 of each log, by its path below their folder."""
    lines = Path(__file__).with_name("SHA256SUMS").read_text(encoding="utf-8").splitlines()
    return {name: digest for digest, name in map(str.split, lines)}


def own_folder() -> Path:
    """Return the user's folder to which the logs are fetched."""
    from platformdirs import user_data_path  # noqa: PLC0415 - slow to import

    return user_data_path("butterfly-testbed", appauthor=False) / "thesis-logs"


def found_folder() -> Path | None:
    """Return the folder that `VARIABLE` names, else the user's own if it holds all logs."""
    if named := os.environ.get(VARIABLE):
        return Path(named)
    own = own_folder()
    return own if all((own / name).is_file() for name in digests()) else None


def fetch(folder: Path, source: str = PUBLISHED, track: Track = untracked) -> int:
    """Fetch the logs that a folder lacks from another, or an address; return how many.

    Each is put in place whole, once its SHA-256 is right; what has been fetched stays. InputError
    if a log cannot be fetched or written, is another one at the source, or a file of its name with
    other content is in the folder already.
    """
    if not source.startswith(_ADDRESSES) and not Path(source).is_dir():
        expected = f"an existing folder, or an address that begins with {' or '.join(_ADDRESSES)}"
        raise InputError("logs fetch", "--from", source, expected)
    missing = [name for name in digests() if not _is_there(folder, name)]

    def bring(name: str) -> None:
        origin = f"{source.rstrip('/')}/{name}"
        with replacing(folder / name) as draft:
            if origin.startswith(_ADDRESSES):
                _download(origin, draft)
            else:
                draft.write_bytes(read_file(Path(origin), "a log to copy"))
            _require(digests()[name], draft, source=origin, more="as the log of this name has")

    with ThreadPoolExecutor(_AT_ONCE) as workers:
        brought = workers.map(bring, missing)
        try:
            for _ in track(missing, "Fetching logs"):
                next(brought)
        finally:
            workers.shutdown(cancel_futures=True)
    return len(missing)


def _is_there(folder: Path, name: str) -> bool:
    """Tell whether a folder has a log; a file of its name that is another is refused."""
    path = folder / name
    if not path.exists():
        return False
    _require(digests()[name], path, source=path, more="or no such file: it is not overwritten")
    return True


def _require(digest: str, path: Path, *, source: object, more: str) -> None:
    with path.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    if found != digest:
        raise InputError(source, "SHA-256", found, f"{digest}, {more}")


def _download(address: str, path: Path) -> None:
    from pooch import HTTPDownloader  # noqa: PLC0415 - slow to import
    from requests import RequestException  # noqa: PLC0415

    try:
        HTTPDownloader(timeout=_TIMEOUT)(address, str(path), None)
    except (RequestException, ValueError) as error:
        expected = (
            "a log; those that have come stay, and the same command goes on "
            "(or takes them from a folder or another address: --from)"
        )
        raise InputError(address, "transfer", _why(error), expected) from None


def _why(error: BaseException) -> object:
    """Return what was at the bottom of a failed transfer, without what requests adds."""
    if (response := getattr(error, "response", None)) is not None:
        return f"{response.status_code} {response.reason}"
    while (cause := error.__cause__ or error.__context__) is not None:
        error = cause
    if isinstance(error, TimeoutError):
        return f"no answer within {_TIMEOUT:g} s"
    return getattr(error, "strerror", None) or error
