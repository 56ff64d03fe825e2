"""All code on the pages runs, or it is said here why not; what is between marks is printed."""

import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

import butterfly as bf
from butterfly.cli.app import GROUPS, program
from butterfly.files import shipped
from tests.conftest import brief_quickstart
from tests.pages.blocks import PAGES, QUOTATION, ROOT, blocks_of, commands_of
from tests.pages.scripts import script

outputs = script("outputs")
LOGS = ROOT.parent / "shared/data/strangers"

ELSEWHERE = {
    "docs/cluster.md": "tests/experiment/test_workers.py, on a cluster of this machine",
    "docs/hardware.md": "tests/plant/test_motor.py, with a drive on loopback",
    "docs/start.md": "below",
}
"""Pages whose code is run by tests of their own."""


def _of_others(text):
    return [outputs.described("dfki", "pendulum", text), outputs.made("examples.free_joints")]


OF_LOGS = {
    "docs/campaign.md": lambda _: [],
    "docs/my-arm.md": lambda _: [outputs.made("examples.arm_logs")],
    "docs/others-logs.md": _of_others,
    "docs/servo.md": lambda text: [outputs.described("xl330", "my-servo", text)],
    "docs/torque-joint.md": lambda _: [outputs.made(outputs.REHEARSED)],
}
"""Pages on logs of their own, and what makes the folders that these lie in, from a page's text."""

NOT_RUN = {
    "butterfly run experiments/orbit-recalibration.yaml": "20 s; tests/cli/test_experiments",
    "butterfly run experiments/orbit-rotation.yaml": "40 s; tests/orbit/test_rotation",
    "butterfly run experiments/orbit-change.yaml": "15 s; tests/orbit/test_watch",
    "butterfly identify real-logs": "the real logs are not shipped; tests/cli/test_verbs",
    "butterfly identify run7.csv": "a file of somebody; test_refusals has its like",
    "butterfly identify push.csv": "a file of somebody; tests/identification/test_cases has it",
    "butterfly identify swing.csv": "a file of somebody; tests/identification/test_cases has it",
    "butterfly identify my-arm --known from": "an arm of somebody; tests/logs/test_motors has it",
    "butterfly run large-sweep": "hours; tests/experiment/test_workers has a few of its runs",
    "butterfly fetch": "asks the network",
    "butterfly compare result.json next-year.json": "next year; test_change",
    "butterfly compare spring.json autumn.json": "next year; test_change",
    "butterfly manifest FOLDER --input setpoint": "a servo of somebody; docs/servo.md has one",
    "butterfly identify FOLDER --model ROBOT.xml": "a robot of somebody; docs/my-arm.md has one",
    "butterfly campaign my_robot:motor --model": "a robot of somebody; tests/api/test_campaigns",
    "butterfly export arm_elbow.json arm_wrist.json --into ROBOT.xml": "the same",
    "butterfly export unit1.json unit2.json unit3.json": "units of somebody; tests/cli/test_robot",
}
"""Beginnings of commands that are not run, and why."""

IN_PLACE = {
    "butterfly campaign my_robot:motor --command 6 --masses 0,0.1 --arm 0.1 --out campaign": (
        "butterfly campaign quickstart --out campaign"
    )
}
"""What is run in the place of commands that need a robot."""

OTHER_PROGRAMS = {
    "pip install": "`make wheel` installs what is built",
    "make": "the house's own; each is named in the Makefile",
    "NUMBA_CACHE_DIR=": "how these tests are run",
    "python -m examples.record_sines --rehearse": "makes the logs of its page, here too",
    "python -m venv mjlab": "gigabytes; `make readback` makes it too",
    "python -m examples.record_sines --channel": "needs a drive; tests/examples/test_record_sines",
    "sudo ip": "needs a CAN bus",
    "candump": "needs a CAN bus",
    "odrv0.": "needs a drive, inside odrivetool",
    "dask": "needs a cluster; tests/experiment/test_workers",
    "srun": "needs a cluster; tests/experiment/test_workers",
    "kubectl": "needs a cluster; tests/experiment/test_workers",
}
"""Beginnings of what blocks tell other programs, and why no test on pages runs it."""
PROGRAM = re.compile(
    r"(?:cc|cd|curl|docker|git|jq|npm|npx|pytest|ssh|uv|wget|[A-Z_]+=\S+|"
    r"pip|make|python3?|sudo|candump|odrv0|dask|srun|kubectl)\b"
)

SLOW = {
    f"docs/{name}.md"
    for name in ("agents", "next-experiment", "orbit", "predictions", "python", "your-robot")
}
WITH_CODE = [
    page
    for page in PAGES
    if page not in {*ELSEWHERE, *OF_LOGS}
    and any(block.commands or block.language == "python" for block in blocks_of(page))
]


def _not_run(command):
    return any(command.startswith(beginning) for beginning in NOT_RUN)


def _exit_code(shown):
    """Return how a command ends, by what the page shows of its answer."""
    return {"Do not": 3, "error:": 2}.get(shown[0][:6], 0) if shown else 0


def _with_answers(page):
    """Return each block of a page with the lines that are quoted after it."""
    blocks = blocks_of(page)
    for block, after in zip(blocks, [*blocks[1:], None], strict=True):
        quoted = after is not None and after.language == QUOTATION
        yield block, [line for line in after.text.splitlines() if line] if quoted else []


def _is_draft(manifest):
    """Whether `butterfly manifest` has written it, and nobody has completed it."""
    return "# To settle:" in manifest.read_text(encoding="utf-8")


class _Reader:
    """Somebody who does what a page says, with a brief quick start in the place of the shipped."""

    def __init__(self, butterfly, quickstart, quoted=()):
        self._butterfly = butterfly
        self._quoted = quoted  # commands that are run where their answers are compared
        self._quickstart = str(quickstart)
        self.names = {}

    def follow(self, page):
        for block, shown in _with_answers(page):
            if block.language == "python":
                brief = block.text.replace('"quickstart"', repr(self._quickstart))
                exec(compile(brief, page, "exec"), self.names)  # noqa: S102 - our own page
            if block.language == "yaml":
                self._describe(block.text)
            for command, answer in block.answered:
                self._do(command, _exit_code(answer or shown))

    @staticmethod
    def _describe(text):
        """Write a manifest into the folder that it names, if that is there and has only a draft."""
        keys = yaml.safe_load(text)
        name = keys.get("name") if isinstance(keys, dict) else None
        manifest = Path(str(name)) / "manifest.yaml"
        if manifest.parent.is_dir() and (not manifest.exists() or _is_draft(manifest)):
            manifest.write_text(text, encoding="utf-8")

    def _do(self, command, wanted):
        if _not_run(command) or command in self._quoted:
            return
        command = IN_PLACE.get(command, command)
        if command.startswith("sed "):
            subprocess.run(command, shell=True, check=True)  # noqa: S602 - our own page
            return
        words = shlex.split(command.partition(" | ")[0])[1:]  # not what other programs make of it
        known = {"quickstart": self._quickstart, "FOLDER": "my-robot"}
        words = [known.get(word, word) for word in words]
        code, _, err = self._butterfly(*words)
        assert code == wanted, f"{command}: {err}"


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    """Folders with quick starts on 9 and on 12 logs, and what they simulate: somebody's robots."""
    folders = [tmp_path_factory.mktemp("robot") for _ in range(2)]
    for folder, few, every in zip(folders, (3, 4), (3, 2), strict=True):
        bf.simulate(brief_quickstart(folder, "grey-box", few, every), out=folder / "data")
    return folders


@pytest.mark.usefixtures("brief_twins")
@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=pytest.mark.slow if page in SLOW else ()) for page in WITH_CODE],
)
def test_a_page_s_code_runs_from_top_to_bottom(page, butterfly, robots, tmp_path, monkeypatch):
    robot = robots[page in SLOW]
    monkeypatch.chdir(tmp_path)
    if page != "docs/your-robot.md":  # which makes it
        (tmp_path / "my-robot").symlink_to(robot / "data")
    reader = _Reader(butterfly, robot / "quick.yaml")
    reader.names.update(logs=bf.read(robot / "data").logs)
    reader.follow(page)
    if page == "docs/your-robot.md":
        assert reader.names["error"] < 0.05  # of the motion, that its twin misses


@pytest.mark.slow
def test_start_runs_from_top_to_bottom(butterfly, tmp_path, monkeypatch):
    """With a quick start of its own; what is printed is compared below."""
    monkeypatch.chdir(tmp_path)
    text = shipped("experiments/quickstart.yaml").read_text(encoding="utf-8")
    quickstart = tmp_path / "quickstart.yaml"
    quickstart.write_text(text.replace("plant:", "plant:\n  simulator: grey-box", 1))
    _Reader(butterfly, quickstart).follow("docs/start.md")


@pytest.mark.slow
@pytest.mark.usefixtures("brief_twins")
@pytest.mark.parametrize("page", OF_LOGS)
def test_a_page_on_logs_of_its_own_runs_from_top_to_bottom(page, butterfly, tmp_path, monkeypatch):
    monkeypatch.setenv("BUTTERFLY_STRANGERS", os.environ.get("BUTTERFLY_STRANGERS") or str(LOGS))
    text = (ROOT / page).read_text(encoding="utf-8")
    for folder in OF_LOGS[page](text):
        if folder is None:
            pytest.skip(f"what {page} identifies is not here (BUTTERFLY_STRANGERS, python-can)")
        shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    for manifest in tmp_path.glob("*/manifest.yaml"):
        manifest.unlink()  # which the page lets its reader write
    monkeypatch.chdir(tmp_path)
    quoted = {mark["command"].strip() for mark in outputs.MARK.finditer(text)}
    _Reader(butterfly, "quickstart", quoted).follow(page)


def _options_of(words):
    """Return the options of the command that words begin with."""
    app = program(words)
    for word in words[: 2 if words[0] in GROUPS else 1]:
        app = app[word]
    own = {name for each in app.assemble_argument_collection() for name in each.names}
    return own | {"--json", "--quiet", "--help-all"}


@pytest.mark.parametrize("page", PAGES)
def test_every_option_that_a_page_names_is_one_of_its_command(page):
    for command in commands_of(page):
        if "--" not in command or "COMMAND" in command or _not_run(command):
            continue
        words = re.sub(r"[\[\]]", " ", command).split()[1:]
        if words[0].startswith("-"):
            continue
        named = {word.split("=")[0] for word in words if word.startswith("--")} - {"--help"}
        first = [each.split("|")[0] for each in words]
        assert named <= _options_of(first), command


def test_what_is_not_run_still_stands_on_a_page():
    commands = [command for page in PAGES for command in commands_of(page)]
    for beginning in NOT_RUN:
        assert any(command.startswith(beginning) for command in commands), beginning


def test_every_command_in_a_block_is_run_or_stands_here_with_its_reason():
    for page in {*ELSEWHERE} - {"docs/start.md"}:
        commands = [command for block in blocks_of(page) for command in block.commands]
        assert [command for command in commands if not _not_run(command)] == [], page


def test_what_blocks_tell_other_programs_stands_here_with_its_reason():
    lines = [
        line
        for page in PAGES
        for block in blocks_of(page)
        if block.language in {"", "sh", "bash"}
        for line in block.text.replace("\\\n", " ").splitlines()
        if PROGRAM.match(line)
    ]
    for line in lines:
        assert any(line.startswith(beginning) for beginning in OTHER_PROGRAMS), line
        if line.startswith("make "):
            assert f"\n{line.split()[1]}:" in (ROOT / "Makefile").read_text(encoding="utf-8")
    for beginning in OTHER_PROGRAMS:
        assert any(line.startswith(beginning) for line in lines), beginning


NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
MARKED = [page for page in PAGES if outputs.MARK.search((ROOT / page).read_text(encoding="utf-8"))]


@pytest.mark.slow
@pytest.mark.parametrize("page", MARKED)
def test_a_page_shows_what_the_program_prints_digits_that_noise_moves_apart(page, monkeypatch):
    monkeypatch.setenv("BUTTERFLY_STRANGERS", os.environ.get("BUTTERFLY_STRANGERS") or str(LOGS))
    shown = (ROOT / page).read_text(encoding="utf-8")
    printed = outputs.written(shown)
    assert NUMBER.sub("#", shown) == NUMBER.sub("#", printed)
    before, now = ([float(each) for each in NUMBER.findall(text)] for text in (shown, printed))
    assert before == pytest.approx(now, rel=0.1, abs=0.05)
