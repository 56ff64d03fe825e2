"""Whoever was given the address may see the viewer, and nobody else."""

import pytest

from butterfly.plant.watch.guard import Guard

GUARD = Guard(8001, "known-to-one")
HOST = {"Host": "127.0.0.1:8001"}
COOKIE = {"Cookie": GUARD.cookie.partition(";")[0]}


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        (f"/?token={GUARD.token}", HOST),
        ("/model", HOST | COOKIE),
        ("/ui?sid=1", HOST | COOKIE | {"Origin": "http://127.0.0.1:8001"}),
        ("/", {"Host": "localhost:8001"} | COOKIE | {"Origin": "http://localhost:8001"}),
    ],
)
def test_who_knows_the_token_is_admitted(path, headers):
    assert GUARD.refusal(path, headers) is None


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/", HOST),
        ("/?token=", HOST),
        (f"/?token={GUARD.token[:-1]}", HOST),
        ("//[?token=x", HOST),
        ("/", COOKIE),
        ("/", {"Host": "evil.example:8001"} | COOKIE),
        ("/", {"Host": "127.0.0.1:8002"} | COOKIE),
        ("/ui", HOST | COOKIE | {"Origin": "http://evil.example"}),
        ("/ui", HOST | COOKIE | {"Origin": "null"}),
        ("/ui", HOST | COOKIE | {"Origin": "http://["}),
        ("/ui", HOST | COOKIE | {"Origin": "https://127.0.0.1:8001"}),
        ("/", HOST | {"Cookie": "butterfly-viewer-8001=guess"}),
        ("/", HOST | {"Cookie": "\x00=;;=,["}),
    ],
)
def test_everybody_else_is_refused(path, headers):
    assert GUARD.refusal(path, headers)


def test_two_viewers_in_one_browser_do_not_lock_each_other_out():
    other = Guard(8002)
    both = {"Cookie": "; ".join(each.cookie.partition(";")[0] for each in (GUARD, other))}
    assert GUARD.refusal("/", HOST | both) is None
    assert other.refusal("/", {"Host": "127.0.0.1:8002"} | both) is None
