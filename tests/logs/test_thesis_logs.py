"""The thesis's logs are fetched whole or not at all, whatever the server does."""

import hashlib
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from butterfly.errors import InputError
from butterfly.files import shipped
from butterfly.logs import thesis_logs
from butterfly.logs.manifest import read_manifest
from butterfly.logs.thesis_logs import Pin, fetch, found_folder, pins
from butterfly.yaml_files import load_yaml

CONTENTS = {f"{group}/{k}.mat": f"{group}, log {k}".encode() * 500 for group in "ab" for k in "12"}
FIRST, *_, LAST = CONTENTS


@pytest.fixture(autouse=True)
def four_logs(monkeypatch):
    of_contents = {
        name: Pin(hashlib.sha256(each).hexdigest(), len(each)) for name, each in CONTENTS.items()
    }
    monkeypatch.setattr(thesis_logs, "pins", lambda: of_contents)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")


@pytest.fixture
def published(tmp_path):
    folder = tmp_path / "published"
    for name, content in CONTENTS.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


def files_of(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


@contextmanager
def served(spoil=None, asked=None, only=CONTENTS):
    """Serve the logs at an address; ``spoil`` answers in the place of some."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            name = self.path.removeprefix("/logs/")
            if asked is not None:
                asked.append(name)
            if spoil and name in only:
                spoil(self, name)
            else:
                self.reply(CONTENTS[name])

        def reply(self, content, length=None):
            self.send_response(200)
            self.send_header("Content-Length", str(length or len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/logs"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def test_the_pinned_logs_are_those_of_the_shipped_data_set(monkeypatch):
    monkeypatch.undo()
    listed = load_yaml(shipped("experiments/real-logs.yaml")).content["logs"]
    assert {entry["file"] for entry in listed} == pins().keys()
    assert all(re.fullmatch("[0-9a-f]{64}", pin.sha256) for pin in pins().values())


def test_the_logs_have_the_pinned_digests(logs_folder, tmp_path, monkeypatch):
    monkeypatch.undo()
    assert fetch(tmp_path, str(logs_folder)) == 41
    assert files_of(tmp_path) == pins().keys()


def test_logs_come_from_an_address_and_only_those_that_are_missing(tmp_path):
    asked, told = [], []

    def track(items, description):
        told.append((len(items), description))
        return items

    with served(asked=asked) as address:
        assert fetch(tmp_path, address, track) == 4
        (tmp_path / FIRST).unlink()
        assert fetch(tmp_path, f"{address}/", track) == 1
        assert fetch(tmp_path, address) == 0
    assert sorted(asked) == sorted([*CONTENTS, FIRST])
    assert told == [(4, "Fetching logs"), (1, "Fetching logs")]


def that_is_not_there(handler, _):
    handler.send_error(404)


def never_answered(*_):
    threading.Event().wait(3.0)


def stopped_in_the_middle(handler, name):
    handler.reply(CONTENTS[name][:100], length=len(CONTENTS[name]))
    never_answered()


def that_has_no_end(handler, name):
    handler.send_response(200)
    handler.end_headers()
    with suppress(OSError):
        while True:
            handler.wfile.write(CONTENTS[name])


def that_comes_drop_by_drop(handler, name):
    handler.reply(b"", length=len(CONTENTS[name]))
    with suppress(OSError):
        for k in range(30):
            handler.wfile.write(CONTENTS[name][k : k + 1])
            handler.wfile.flush()
            time.sleep(0.1)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (
            lambda handler, name: handler.reply(CONTENTS[name][:100], len(CONTENTS[name])),
            "transfer: got IncompleteRead",
        ),
        (lambda handler, _: handler.reply(b"<html>Please log in</html>"), "SHA-256: got"),
        (that_is_not_there, "transfer: got 404 Not Found"),
        (never_answered, "transfer: got no answer within 1.5 s"),
        (stopped_in_the_middle, "transfer: got no answer within 1.5 s"),
        (that_has_no_end, "transfer: got more than"),
    ],
)
def test_a_broken_transfer_leaves_nothing_and_the_next_call_goes_on(
    tmp_path, spoil, said, monkeypatch
):
    if "no answer" in said:
        monkeypatch.setattr("butterfly.logs.thesis_logs._TIMEOUT", 1.5)
    with (
        served(spoil, only={LAST}) as address,
        pytest.raises(InputError, match=re.escape(f"{address}/{LAST}: {said}")),
    ):
        fetch(tmp_path, address)
    assert files_of(tmp_path) == CONTENTS.keys() - {LAST}
    asked = []
    with served(asked=asked) as address:
        assert fetch(tmp_path, address) == 1
    assert asked == [LAST]


def test_all_logs_have_one_deadline_however_slowly_one_comes(tmp_path, monkeypatch):
    monkeypatch.setattr(thesis_logs, "_DEADLINE", 1.0)
    begin = time.monotonic()
    with (
        served(that_comes_drop_by_drop, only={LAST}) as at,
        pytest.raises(InputError, match=r"transfer: got 1 logs still missing after 1 s"),
    ):
        fetch(tmp_path, at)
    assert time.monotonic() - begin < 4.5  # the server's own end, which waits for its 3 s
    assert files_of(tmp_path) == CONTENTS.keys() - {LAST}


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has other signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_stop_it_while_a_server_says_nothing(tmp_path, number):
    program = (
        "from butterfly.logs.thesis_logs import fetch; from pathlib import Path; "
        f"print(1, flush=True); fetch(Path({str(tmp_path)!r}), "
    )
    with served(never_answered) as address:
        words = [sys.executable, "-c", f"{program}{address!r})"]
        child = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)  # noqa: S603
        child.stdout.readline()
        time.sleep(0.5)
        child.send_signal(number)
        assert child.wait(15.0) != 0
        child.stdout.close()
    assert not files_of(tmp_path)


def test_after_a_failure_no_further_logs_are_asked_for(tmp_path, monkeypatch):
    monkeypatch.setattr(thesis_logs, "_AT_ONCE", 1)
    asked = []
    with served(that_is_not_there, asked) as address, pytest.raises(InputError, match="404"):
        fetch(tmp_path, address)
    assert len(asked) <= 2


def test_a_server_that_is_not_there_is_named(tmp_path):
    with served() as address:
        pass
    with pytest.raises(InputError, match=rf"{address}/{FIRST}: transfer: got .*refused"):
        fetch(tmp_path, address)
    assert not files_of(tmp_path)


def test_a_full_disk_leaves_nothing_half_written(tmp_path, published, monkeypatch):
    def write(path, content):
        with path.open("wb") as file:
            file.write(content[:100])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", write)
    with pytest.raises(InputError, match="No space left on device"):
        fetch(tmp_path / "own", str(published))
    assert not files_of(tmp_path / "own")


def test_a_file_with_other_content_is_refused_before_anything_is_fetched(tmp_path, published):
    own = tmp_path / "own" / LAST
    own.parent.mkdir(parents=True)
    own.write_bytes(b"mine")
    with pytest.raises(InputError, match=r"SHA-256: got .*not overwritten") as caught:
        fetch(tmp_path / "own", str(published))
    assert caught.value.source == str(own)
    assert files_of(tmp_path / "own") == {LAST}
    assert own.read_bytes() == b"mine"


def test_a_folder_without_a_log_or_none_at_all_is_named(tmp_path, published):
    (published / LAST).unlink()
    with pytest.raises(InputError, match=f"{LAST}: path: got no such file"):
        fetch(tmp_path / "own", str(published))
    for source in (str(tmp_path / "nowhere"), "ftp://127.0.0.1/logs"):
        with pytest.raises(InputError, match=rf"--from: got {source}; expected an existing folder"):
            fetch(tmp_path / "own", source)


ROOT = "name: a\ninput: torque\nroot: ${BUTTERFLY_LOGS}\nlogs: [{file: a/1.mat}]\n"


def test_a_data_set_finds_the_logs_where_the_variable_says_or_where_they_were_fetched(
    tmp_path, published, monkeypatch
):
    path, own = tmp_path / "real.yaml", tmp_path / "own"
    path.write_text(ROOT)
    monkeypatch.setattr(thesis_logs, "own_folder", lambda: own)
    monkeypatch.delenv("BUTTERFLY_LOGS", raising=False)
    with pytest.raises(InputError, match="run `butterfly fetch`"):
        read_manifest(path)
    fetch(own, str(published))
    assert read_manifest(path).root == str(own)
    monkeypatch.setenv("BUTTERFLY_LOGS", str(published))
    assert read_manifest(path).root == str(published)
    monkeypatch.delenv("BUTTERFLY_LOGS")
    (own / LAST).unlink()
    assert found_folder() is None  # some of the logs are no data set
