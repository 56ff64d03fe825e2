"""The command that fetches the thesis's logs."""

import hashlib

import pytest

from butterfly.logs import thesis_logs
from tests.cli.one_line import assert_one_line_error


@pytest.fixture
def published(tmp_path, monkeypatch):
    """A folder with the one log that there is."""
    folder = tmp_path / "published"
    folder.mkdir()
    (folder / "log.mat").write_bytes(b"log")
    digest = hashlib.sha256(b"log").hexdigest()
    monkeypatch.setattr(thesis_logs, "digests", lambda: {"log.mat": digest})
    monkeypatch.setattr(thesis_logs, "own_folder", lambda: tmp_path / "own")
    monkeypatch.delenv("BUTTERFLY_LOGS", raising=False)
    return folder


def test_logs_are_fetched_to_where_real_logs_finds_them(butterfly, published, tmp_path):
    code, out, err = butterfly("fetch", "--from", published)
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        f"1 logs, 1 of them fetched: {tmp_path / 'own'}",
        "Next: butterfly identify real-logs",
    ]
    assert (tmp_path / "own/log.mat").read_bytes() == b"log"
    assert "1 logs, 0 of them fetched" in butterfly("fetch", "--from", published)[1]


def test_a_folder_of_ones_own_is_told_to_the_next_command(butterfly, published, tmp_path):
    _, out, _ = butterfly("fetch", "--from", published, "--out", tmp_path / "my logs")
    assert out.endswith(f'identify real-logs --root "{tmp_path / "my logs"}"\n')
    assert (tmp_path / "my logs/log.mat").exists()


def test_what_cannot_be_fetched_is_one_line_that_names_it(butterfly, published):
    (published / "log.mat").write_bytes(b"another")
    result = butterfly("fetch", "--from", published)
    assert_one_line_error(result, published / "log.mat", "SHA-256")
    assert_one_line_error(butterfly("fetch", "--from", "nowhere"), "--from", "nowhere")
