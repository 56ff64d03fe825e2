"""The system's Chromium, for tests of pages."""

import json
import shutil
import subprocess

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
FLAGS = [
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-extensions", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--enable-logging=stderr", "--dump-dom"),
    "--host-resolver-rules=MAP * ~NOTFOUND",
]
"""Of a browser whose network is refused: to it no name has an address."""
HASTE = "--virtual-time-budget=10000"
"""Ten seconds of the page's own time, which passes faster."""

needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium on this machine to look at the report"
)


def seen_by_chromium(page, folder, *more):
    """The document that a page becomes, if it says nothing on the console and asks for nothing."""
    seen, asked = opened(page, folder, *more)
    assert "CONSOLE" not in seen.stderr
    assert asked == []
    return seen.stdout


def opened(page, folder, *more):
    """What Chromium says of a page, and the addresses that the page, not Chromium, asks for."""
    log = folder / "network.json"
    own = [f"--user-data-dir={folder / 'profile'}", f"--log-net-log={log}"]
    command = [CHROMIUM, *FLAGS, *own, *more, page.as_uri()]
    seen = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)  # noqa: S603 - our own page
    logged = json.loads(log.read_text(encoding="utf-8"))
    begun = logged["constants"]["logEventTypes"]["URL_REQUEST_START_JOB"]
    events = [each["params"] for each in logged["events"] if each["type"] == begun]
    asked = [e["url"] for e in events if "url" in e and e.get("initiator") != "not an origin"]
    return seen, [each for each in asked if not each.startswith(("file:", "data:", "blob:"))]
