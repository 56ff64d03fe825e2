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
    ways = [_flipped, _overwritten, _cut, _stuffed, _absurd, _blanked, _lost]
    if b"\0" not in content:
        ways += [*3 * [_reworded], _lines_lost, _lines_doubled, *2 * [_digit]]
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


def _blanked(content: bytearray, rng: random.Random) -> bytes:
    """Put zeros in the place of a block, as a disk does."""
    begin, end = _stretch(len(content), rng)
    content[begin:end] = bytes(end - begin)
    return bytes(content)


def _lost(content: bytearray, rng: random.Random) -> bytes:
    begin, end = _stretch(len(content), rng)
    del content[begin:end]
    return bytes(content)


def _lines_lost(content: bytearray, rng: random.Random) -> bytes:
    lines = content.splitlines(keepends=True)
    begin, end = _stretch(len(lines), rng)
    return b"".join(lines[:begin] + lines[end:])


def _lines_doubled(content: bytearray, rng: random.Random) -> bytes:
    lines = content.splitlines(keepends=True)
    begin, end = _stretch(len(lines), rng)
    return b"".join(lines[:end] + lines[begin:])


def _digit(content: bytearray, rng: random.Random) -> bytes:
    """Put another digit in the place of one."""
    if places := [k for k, each in enumerate(content) if chr(each).isdigit()]:
        content[rng.choice(places)] = ord(rng.choice("0123456789"))
    return bytes(content)


def _stretch(size: int, rng: random.Random) -> tuple[int, int]:
    """Return a place, and another at most 1, 10, 512 or 4096 behind it."""
    begin = rng.randrange(size)
    return begin, min(size, begin + rng.randint(1, rng.choice((1, 10, 512, 4096))))
