"""What happens to files: bits flip, ends are lost, bytes come in between, numbers turn absurd."""

import random
import re

_HEAD = 400
_ABSURD = (0, 1, 5, 9, 14, 15, 255, 1 << 31, (1 << 31) - 1, (1 << 32) - 1)


_WORD = re.compile(rb"[\w.+-]+")
_WORDS = (
    *(b"0 1 -1 1e999 -1e308 1e-320 .inf .nan nan 1e9 1e30 9" + b"9" * 40).split(),
    *b"null true [] {} [1,2] {a:1} [[[[]]]] ~ .. . con aux.txt ../x /etc/hosts".split(),
    *b"*a &a !!int !x".split(),
    *(b"2001-99-99", b"0x1F", b"0o17", b"1_000", b"12:30:45", b"<<", b"=", b"'", b'"', b"|", b">"),
    *(b"[bold]", b"[/]", b"$x$", b"=1+1", b"<b>", b"%", b"x" * 5000, b"\0", b"\xff", "é√".encode()),
    b"[" * 2000,
)


def damaged(content: bytes, rng: random.Random) -> bytes:
    """Return a file's content after one misfortune."""
    ways = [_flipped, _overwritten, _cut, _stuffed, _absurd]
    if b"\0" not in content:
        ways += 3 * [_reworded]
    return rng.choice(ways)(bytearray(content), rng)


def _reworded(content: bytearray, rng: random.Random) -> bytes:
    """Put something else in the place of a word or a number."""
    for _ in range(rng.choice((1, 1, 2))):
        found = list(_WORD.finditer(content))
        if found:
            word = rng.choice(found)
            content[word.start() : word.end()] = rng.choice(_WORDS)
    return bytes(content)


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
