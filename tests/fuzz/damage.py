"""What happens to files: bits flip, ends are lost, bytes come in between, numbers turn absurd."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import random

_HEAD = 400
_ABSURD = (0, 1, 5, 9, 14, 15, 255, 1 << 31, (1 << 31) - 1, (1 << 32) - 1)


def damaged(content: bytes, rng: random.Random) -> bytes:
    """Return a file's content after one misfortune."""
    return rng.choice((_flipped, _overwritten, _cut, _stuffed, _absurd))(bytearray(content), rng)


def _flipped(content: bytearray, rng: random.Random) -> bytes:
    for _ in range(rng.choice((1, 1, 2, 4))):
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    return bytes(content)


def _overwritten(content: bytearray, rng: random.Random) -> bytes:
    for _ in range(rng.choice((1, 2, 8))):
        content[rng.randrange(min(_HEAD, len(content)))] = rng.randrange(256)
    return bytes(content)


def _cut(content: bytearray, rng: random.Random) -> bytes:
    return bytes(content[: rng.randrange(len(content))])


def _stuffed(content: bytearray, rng: random.Random) -> bytes:
    place = rng.randrange(len(content))
    content[place:place] = rng.randbytes(rng.choice((1, 4, 8)))
    return bytes(content)


def _absurd(content: bytearray, rng: random.Random) -> bytes:
    place = rng.randrange(len(content)) // 4 * 4
    content[place : place + 4] = rng.choice(_ABSURD).to_bytes(4, "little")
    return bytes(content)
