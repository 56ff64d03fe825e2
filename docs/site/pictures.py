"""Draw the pictures of docs/ anew: `make pictures`, after pages or figures have changed.

Each is of a command that a page shows, in the run whose answer that page quotes: a figure of the
program, or the first screen of the page it writes, from the system's Chromium. Beside it lies the
record of what it shows. Those of logs that are not shipped stay as they are where these are not in
BUTTERFLY_STRANGERS. `make pictures PICTURES='cart arm'` draws these two.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from first_screen import lines_of, picture_of
from front_page import HAND, LOG, fit_shown, hand_shown
from outputs import DOCS, REHEARSED, described, made, printed, quickstart
from PIL import Image
from records import PICTURES, recorded, texts_of, write_record

import butterfly

COLOURS = 96
"""Enough for drawings; a picture then takes some tens of kB."""
SHADES = 256
"""Of what lies in a light."""
SWEEP = """extends: quickstart.yaml
name: sweep
plant: {simulator: grey-box}
sweep: {grid: {plant.encoder.steps: [1024, 16384], plant.encoder.noise: [0, 1.0e-3]}}
"""


class Still(NamedTuple):
    """A picture of what a command writes."""

    name: str
    command: str  # as pages show it
    drawn: str  # page or figure, in the folder where the command runs
    options: str = ""  # by which it is written, where pages do not show them
    folder: Callable[[], Path | None] = quickstart

    def run(self) -> Path | None:
        """Run the command; return the folder, or none where its logs are not here."""
        folder = self.folder()
        if folder is not None:
            printed(self.written_out, folder)
            if not (folder / self.drawn).exists():
                sys.exit(f"butterfly {self.written_out} has not written {self.drawn}")
        return folder

    @property
    def written_out(self) -> str:
        """What the program is told, without its name."""
        return f"{self.command} {self.options}".strip()

    def record(self, folder: Path) -> dict[str, Any]:
        """Return what is to be seen in what the command has written."""
        drawn = folder / self.drawn
        shown = lines_of(drawn) if drawn.suffix == ".html" else texts_of(drawn)
        return recorded(f"butterfly {self.command}", shown, printed(self.written_out, folder))


def _figures_of_free_joint(name: str) -> Still:
    """Return the picture of joints that nothing holds, by the command on its page."""
    page = (DOCS / "others-logs.md").read_text(encoding="utf-8")
    command = next(
        line.strip().removeprefix("butterfly ")
        for line in page.splitlines()
        if line.startswith(f"    butterfly identify {name} ")
    )
    options = f"--report {name}.html --figures"
    return Still(name, command, f"{name}-figures/time.png", options, _free_joints)


def _free_joints() -> Path | None:
    return made("examples.free_joints")


def _rehearsed() -> Path | None:
    return made(REHEARSED)


def _servo() -> Path | None:
    page = (DOCS / "servo.md").read_text(encoding="utf-8")
    return described("xl330", "my-servo", page)


def _pendulum() -> Path | None:
    page = (DOCS / "others-logs.md").read_text(encoding="utf-8")
    return described("dfki", "pendulum", page)


@cache
def _saved() -> Path:
    """Return the folder of the quick start, with a saved result."""
    folder = quickstart()
    printed("identify my-robot --save result.json", folder)
    return folder


@cache
def _with_sweep() -> Path:
    """Return the folder of the quick start, with a sweep to run."""
    folder = quickstart()
    (folder / "sweep.yaml").write_text(SWEEP, encoding="utf-8")
    return folder


@cache
def _campaign() -> Path:
    """Return the folder of the quick start, with a campaign's figures."""
    folder = quickstart()
    printed(CAMPAIGN, folder)
    campaign = butterfly.load(folder / "rehearsal/report.json")
    campaign.report(folder / "campaign.html", figures=True)
    return folder


QUICK = "results/quickstart"
CAMPAIGN = "campaign quickstart --out rehearsal"
PREDICTION = "predict my-robot --with result.json --bands --report prediction.html"
STILLS = (
    *(
        Still(name, "run quickstart", f"{QUICK}/{drawn}", "--figures")
        for name, drawn in (
            ("report", "report.html"),
            ("time", "report-figures/time.png"),
            ("frequency-response", "report-figures/frequency-response.png"),
            ("intervals", "report-figures/parameters.png"),
            ("corner", "report-figures/corner.png"),
        )
    ),
    Still("wrong-mass", f"identify {QUICK}/wrong.yaml", "wrong.html", "--report wrong.html"),
    Still("design", "design my-robot --goal 0.05%", "design.html", "--report design.html"),
    Still("prediction", PREDICTION, "prediction.html", folder=_saved),
    Still("sweep", "run sweep.yaml", "results/sweep/report.html", folder=_with_sweep),
    Still("recalibration", "run orbit-recalibration", "results/orbit-recalibration/orbit.html"),
    Still("shrinking", CAMPAIGN, "campaign-figures/shrinking.png", folder=_campaign),
    Still("played", CAMPAIGN, "campaign-figures/played.png", folder=_campaign),
    _figures_of_free_joint("cart"),
    _figures_of_free_joint("arm"),
    Still(
        "joints",
        "identify logs --model arm.xml --of all --input torque --known p4=1",
        "joints.html",
        "--report joints.html",
        lambda: made("examples.arm_logs"),
    ),
    Still(
        "servo",
        "identify my-servo",
        "servo-figures/time.png",
        "--report servo.html --figures",
        _servo,
    ),
    Still(
        "torque-joint",
        "identify logs",
        "torque-joint-figures/time.png",
        "--report torque-joint.html --figures",
        _rehearsed,
    ),
    Still("pendulum", "identify pendulum", "pendulum.html", "--report pendulum.html", _pendulum),
)


def main(names: list[str]) -> None:
    """Draw the pictures named, or all."""
    known = {still.name: still for still in STILLS}
    if unknown := {*names} - {*known, HAND, LOG}:
        sys.exit(f"no such picture: {', '.join(sorted(unknown))}")
    for name in names or [*known, HAND, LOG]:
        if name in known:
            _draw(known[name])
        else:
            _draw_front_page(name)


def _draw(still: Still) -> None:
    """Draw a picture of what a command writes, if it can run here."""
    folder = still.run()
    if folder is None:
        print(f"{still.name}.png stays as it is: its logs are not in BUTTERFLY_STRANGERS")
        return
    drawn = folder / still.drawn
    picture = PICTURES / f"{still.name}.png"
    _keep(picture_of(drawn) if drawn.suffix == ".html" else drawn, picture)
    write_record(picture, still.record(folder))


def _draw_front_page(name: str) -> None:
    """Draw one of the two pictures that no command writes."""
    picture = PICTURES / f"{name}.png"
    with tempfile.TemporaryDirectory() as folder:
        drawn = Path(folder) / picture.name
        shown = hand_shown(drawn) if name == HAND else fit_shown(quickstart() / QUICK, drawn)
        _keep(drawn, picture, SHADES)
    write_record(picture, recorded("docs/site/front_page.py", shown))


def _keep(drawn: Path, picture: Path, colours: int = COLOURS) -> None:
    """Write a picture with few colours."""
    with Image.open(drawn) as drawing:
        few = drawing.convert("RGB").quantize(colours, dither=Image.Dither.NONE)
    few.save(picture, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1:])
