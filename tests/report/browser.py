"""The system's Chromium, for tests of pages."""

import shutil
import subprocess

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-extensions "
    "--disable-background-networking --disable-component-update --disable-sync "
    "--enable-logging=stderr --dump-dom"
)
HASTE = "--virtual-time-budget=10000"
"""Ten seconds of the page's own time, which passes faster."""

needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium on this machine to look at the report"
)


def seen_by_chromium(page, folder, *more):
    """The document that a page becomes, if it says nothing on the console."""
    command = [CHROMIUM, *FLAGS.split(), *more, f"--user-data-dir={folder / 'profile'}"]
    command.append(page.as_uri())
    seen = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)  # noqa: S603 - our own page
    assert "CONSOLE" not in seen.stderr
    return seen.stdout
