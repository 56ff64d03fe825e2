"""What a page shows before anybody scrolls, as a picture and as lines of text, by Chromium."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from html import unescape
from pathlib import Path

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
SCREEN = (1000, 760)
"""Of a page's first screen, in pixels."""
BEGIN, END = "[shown[", "]shown]"
READER = """<script>
addEventListener("load", () => setTimeout(() => {
  const lines = new Map(), texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const rows = "tr, li, p, h1, h2, h3, dl > div, summary, .badge, text, figcaption";
  while (texts.nextNode()) {
    const text = texts.currentNode.textContent.trim(), range = document.createRange();
    range.selectNodeContents(texts.currentNode);
    const box = range.getBoundingClientRect(), holder = texts.currentNode.parentElement;
    if (!text || !box.width || box.top < 0 || box.left < 0) continue;
    if (holder.closest("details:not([open])") && !holder.closest("summary")) continue;
    if (box.bottom > WINDOW_HEIGHT || box.right > WINDOW_WIDTH) continue;
    const row = holder.closest(rows) || holder;
    lines.set(row, [...(lines.get(row) || []), text]);
  }
  const answer = document.createElement("pre");
  answer.textContent = "BEGIN" + JSON.stringify([...lines.values()].map(x => x.join(" "))) + "END";
  document.body.append(answer);
}, 3000));
</script>"""


def picture_of(page: Path) -> Path:
    """Return a picture of a page's first screen."""
    taken = page.with_suffix(".png")
    _chromium(page, f"--screenshot={taken}")
    return taken


def lines_of(page: Path) -> list[str]:
    """Return the lines of text on a page's first screen: of a table a line for each row."""
    script = READER.replace("WINDOW_WIDTH", str(SCREEN[0])).replace("WINDOW_HEIGHT", str(SCREEN[1]))
    script = script.replace("BEGIN", BEGIN).replace("END", END)
    with tempfile.TemporaryDirectory() as name:
        copy = Path(name) / page.name
        text = page.read_text(encoding="utf-8")
        copy.write_text(text.replace("</body>", f"{script}</body>"), encoding="utf-8")
        dumped = _chromium(copy, "--dump-dom")
    answer = unescape(dumped.rpartition(BEGIN)[2].rpartition(END)[0])
    return [" ".join(line.split()) for line in json.loads(answer)]


def _chromium(page: Path, *asked: str) -> str:
    """Let Chromium open a page; return what it prints."""
    if CHROMIUM is None:
        sys.exit("neither chromium nor google-chrome is installed")
    with tempfile.TemporaryDirectory() as profile:
        options = (
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            "--no-first-run",
            "--disable-background-networking",
            "--virtual-time-budget=10000",
            f"--user-data-dir={profile}",
            f"--window-size={SCREEN[0]},{SCREEN[1]}",
        )
        command = [CHROMIUM, *options, *asked, page.as_uri()]
        ran = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603 - found above
    return ran.stdout
