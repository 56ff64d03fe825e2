"""Draw the pictures of docs/ anew: `make pictures`, after pages or figures have changed.

Nearly all come from the quick start, as docs/start.md runs it: the figures from the program, the
first screens of its pages from the system's Chromium. Cart and arm come from
examples/free_joints.py, the servo's and the pendulum's from their logs, in the folders xl330 and
dfki of BUTTERFLY_STRANGERS, where that is set.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from front_page import draw_front_page
from PIL import Image

import butterfly

PICTURES = Path(__file__).parents[1] / "pictures"
EXAMPLES = Path(__file__).parents[2] / "examples"
PROGRAM = shutil.which("butterfly", path=str(Path(sys.executable).parent))
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
SCREEN = (1000, 760)
"""Of a page's first screen, in pixels."""
COLOURS = 96
"""Enough for drawings; a picture then takes some tens of kB."""


def main() -> None:
    """Run the quick start, tell it a wrong mass, and keep the pictures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _butterfly("run", "quickstart", "--figures", folder=folder)
        results = folder / "results/quickstart"
        text = (results / "manifest.yaml").read_text(encoding="utf-8")
        wrong = text.replace("added_mass: 0.12", "added_mass: 0.13")
        (results / "wrong.yaml").write_text(wrong, encoding="utf-8")
        told = ("identify", "results/quickstart/wrong.yaml", "--report", "wrong.html")
        _butterfly(*told, folder=folder)
        for figure in ("frequency-response", "time"):
            _keep(results / f"report-figures/{figure}.png", figure)
        _keep(results / "report-figures/parameters.png", "intervals")
        _pages_of_tasks(folder)
        _free_joints(folder)
        draw_front_page(results, PICTURES)
        _keep(_first_screen(results / "report.html"), "report")
        _keep(_first_screen(folder / "wrong.html"), "wrong-mass")
        if named := os.environ.get("BUTTERFLY_STRANGERS"):
            shutil.copytree(Path(named) / "xl330", folder / "my-servo")
            shutil.copy(EXAMPLES / "servo.yaml", folder)
            told = ("identify", "servo.yaml", "--report", "servo.html", "--figures")
            _butterfly(*told, folder=folder)
            _keep(folder / "servo-figures/time.png", "servo")
            shutil.copytree(Path(named) / "dfki", folder / "pendulum")
            page = (PICTURES.parent / "others-logs.md").read_text(encoding="utf-8")
            described = re.search(r"```yaml\n(.*?)```", page, re.DOTALL)
            if described:
                (folder / "pendulum/manifest.yaml").write_text(described[1], encoding="utf-8")
            _butterfly("identify", "pendulum", "--report", "pendulum.html", folder=folder)
            _keep(_first_screen(folder / "pendulum.html"), "pendulum")


def _pages_of_tasks(folder: Path) -> None:
    """Draw the first screens of the pages that other tasks write."""
    data = "results/quickstart"
    _butterfly("design", data, "--goal", "0.05%", "--report", "design.html", folder=folder)
    _butterfly("identify", data, "--save", "result.json", folder=folder)
    ahead = ("predict", data, "--with", "result.json", "--bands", "--report", "prediction.html")
    _butterfly(*ahead, folder=folder)
    sweep = "extends: quickstart.yaml\nname: sweep\nplant: {simulator: grey-box}\n"
    sweep += (
        "sweep: {grid: {plant.encoder.steps: [1024, 16384], plant.encoder.noise: [0, 1.0e-3]}}\n"
    )
    (folder / "sweep.yaml").write_text(sweep, encoding="utf-8")
    _butterfly("run", "sweep.yaml", folder=folder)
    _butterfly("run", "orbit-recalibration", folder=folder)
    _butterfly("campaign", "quickstart", "--goal", "0.15%", "--out", "campaign", folder=folder)
    butterfly.load(folder / "campaign/report.json").report(folder / "campaign.html", figures=True)
    for figure in ("shrinking", "played"):
        _keep(folder / f"campaign-figures/{figure}.png", figure)
    pages = {
        "design": folder / "design.html",
        "prediction": folder / "prediction.html",
        "sweep": folder / "results/sweep/report.html",
        "orbit": folder / "results/orbit-recalibration/orbit.html",
    }
    for name, page in pages.items():
        _keep(_first_screen(page), name)


def _free_joints(folder: Path) -> None:
    """Draw a log of joints that nothing holds, with its simulation."""
    module = [sys.executable, "-m", "examples.free_joints", "--out", str(folder)]
    subprocess.run(module, cwd=EXAMPLES.parent, check=True)  # noqa: S603 - our own
    page = (PICTURES.parent / "others-logs.md").read_text(encoding="utf-8")
    for name in ("cart", "arm"):
        found = re.search(rf"^    butterfly (identify {name} .*)$", page, re.MULTILINE)
        if found is None:
            sys.exit(f"docs/others-logs.md identifies no {name}")
        _butterfly(*found[1].split(), "--report", f"{name}.html", "--figures", folder=folder)
        _keep(folder / f"{name}-figures/time.png", name)


def _butterfly(*command: str, folder: Path, ends: int = 0) -> None:
    if PROGRAM is None:
        sys.exit("butterfly is not installed beside this Python")
    ended = subprocess.run([PROGRAM, *command], cwd=folder, check=False)  # noqa: S603 - our own
    if ended.returncode != ends:
        sys.exit(f"butterfly {' '.join(command)} ended with {ended.returncode}")


def _first_screen(page: Path) -> Path:
    """Return a picture of what a page shows before anybody scrolls."""
    if CHROMIUM is None:
        sys.exit("neither chromium nor google-chrome is installed")
    taken = page.with_suffix(".png")
    options = (
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        "--no-first-run",
        "--disable-background-networking",
        "--virtual-time-budget=10000",
        f"--user-data-dir={page.parent / 'browser'}",
        f"--window-size={SCREEN[0]},{SCREEN[1]}",
        f"--screenshot={taken}",
    )
    command = [CHROMIUM, *options, page.as_uri()]
    subprocess.run(command, check=True, stderr=subprocess.DEVNULL)  # noqa: S603 - found above
    return taken


def _keep(drawn: Path, name: str) -> None:
    PICTURES.mkdir(exist_ok=True)
    with Image.open(drawn) as picture:
        few = picture.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
        few.save(PICTURES / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
