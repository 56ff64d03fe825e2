"""A picture, the record beside it, the pages that show it and the program say the same."""

import os
import re

import pytest

from tests.pages.blocks import PAGES, ROOT, commands_of
from tests.pages.scripts import script

records, pictures, front_page = (script(name) for name in ("records", "pictures", "front_page"))
first_screen = script("first_screen")

FOLDER = ROOT / "docs/pictures"
DRAWN = sorted([*FOLDER.glob("*.png"), *FOLDER.glob("*.gif")])
NAMES = [path.stem for path in DRAWN]
LARGEST = 300_000  # bytes of a still
LINK = re.compile(r"!\[[^\]]*\]\(([^)]+)\)")
NUMBER = re.compile(r"[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
WRITES = re.compile(r" --(?:report|save|out) \S+| --figures")
"""Options that say where an answer is written, and change none."""
OF_ITS_OWN = {"docs/site/front_page.py", "butterfly run sweep.yaml"}
"""What no page tells a reader to run."""
BESIDE_THE_TEXT = [
    ("docs/start.md", "FIT is still 96 %", "wrong-mass", "FIT, median of all logs 96.1 %"),
    ("docs/start.md", "24 noisy logs", "report", "logs 24 3 added masses"),
    ("docs/start.md", "with 50 g and 120 g added", "frequency-response", "50 g, model\n120 g"),
    ("README.md", "*Good: p1 ±0.017 %, p4 ±0.013 %*", "report", "p1 ±0.017 %, p4 ±0.013 %"),
    ("docs/orbit.md", "97° at first", "recalibration", "Reached 59.95° in 2 rounds; before, 97°"),
    ("docs/orbit.md", "(then 59.95°)", "recalibration", "amplitude reached 59.95° of 60°"),
    (
        "README.md",
        "97° with the model from small swings, then 59.95°",
        "recalibration",
        "Reached 59.95° in 2 rounds; before, 97°",
    ),
    ("docs/your-robot.md", "A log of 120 g at 6 rad/s", "quickstart", "log: 120 g, 6 rad/s"),
    ("docs/orbit.md", "The hand pumped over the top", "rotation", "hand at most 897°"),
    ("docs/predictions.md", "inside both 95 % bands", "prediction", "95 %"),
]
"""What a page says of a picture in words, and the picture itself."""


def _text(page):
    return (ROOT / page).read_text(encoding="utf-8")


def _seen(name):
    """Return what can be read in a picture, as one text."""
    return "\n".join(records.record_of(name)["shown"])


def test_every_picture_is_shown_has_a_record_and_a_name_of_its_own():
    shown = {
        (ROOT / page).parent.joinpath(path).resolve()
        for page in PAGES
        for path in LINK.findall(_text(page))
    }
    assert {path for path in shown if path.parent == FOLDER} == {*DRAWN}
    assert sorted(path.stem for path in FOLDER.glob("*.json")) == sorted(NAMES)


def test_make_pictures_draws_every_still_and_each_is_small():
    stills = [path.stem for path in DRAWN if path.suffix == ".png"]
    drawn = [*(still.name for still in pictures.STILLS), front_page.HAND, front_page.LOG]
    assert sorted(drawn) == sorted(stills)
    assert all((FOLDER / f"{name}.png").stat().st_size < LARGEST for name in stills)


@pytest.mark.parametrize("picture", DRAWN, ids=NAMES)
def test_a_record_is_that_of_its_picture(picture):
    assert records.record_of(picture.stem)["digest"] == records.digest(picture)


@pytest.mark.parametrize("name", NAMES)
def test_a_picture_s_run_answered_what_pages_quote_of_it(name):
    record = records.record_of(name)
    stands = {
        f"{mark['keep']} {mark['what']}": mark["shown"].splitlines()
        for mark in records.quoting(record["command"])
    }
    assert not record["quoted"] or record["quoted"] == stands


@pytest.mark.parametrize("still", pictures.STILLS, ids=lambda still: still.name)
def test_what_pages_quote_is_recorded_of_every_picture_that_a_command_makes(still):
    record = records.record_of(still.name)
    assert record["command"] == f"butterfly {still.command}"
    assert bool(record["quoted"]) == bool(records.quoting(record["command"]))


@pytest.mark.parametrize("name", NAMES)
def test_a_page_s_verdict_is_seen_as_the_console_prints_it(name):
    record = records.record_of(name)
    badges = [k for k, line in enumerate(record["shown"]) if line.startswith(("✓ ", "! ", "✕ "))]
    for badge in badges:
        level, *lines = record["shown"][badge : badge + 3]
        rated = f"> {level[2:]}: {lines[0]}"
        assert record["quoted"].get("head 2", [rated, ">", f"> {lines[1]}"])[0] == rated


@pytest.mark.parametrize(("page", "words", "name", "seen"), BESIDE_THE_TEXT)
def test_a_page_says_in_words_what_its_picture_shows(page, words, name, seen):
    assert words in " ".join(_text(page).split())
    assert seen in _seen(name)


def test_start_says_how_wrong_the_values_of_a_wrong_mass_are():
    true = dict(line.split() for line in records.record_of(front_page.HAND)["shown"][1:])
    rows = [line.split() for line in records.record_of("wrong-mass")["shown"]]
    numbers = {row[0]: [word for word in row if NUMBER.fullmatch(word)] for row in rows}
    wrong = {
        name: 100 * abs(float(numbers[name][0]) / float(true[name]) - 1)
        for name in true
        if numbers.get(name)  # those above the picture's lower edge
    }
    *others, last = wrong
    share = f"{min(wrong.values()):.0f} to {max(wrong.values()):.0f} %"
    assert len(wrong) >= 3
    assert f"{', '.join(others)} and {last} are {share} wrong" in _text("docs/start.md")


@pytest.mark.parametrize("name", NAMES)
def test_a_picture_is_of_a_command_that_a_page_shows(name):
    made_by = records.record_of(name)["command"]
    shown = {WRITES.sub("", command) for page in PAGES for command in commands_of(page)}
    shown |= {command.replace("experiments/", "").replace(".yaml", "") for command in shown}
    quoted = {mark["command"].strip() for mark in records.marks()}
    assert made_by in OF_ITS_OWN or WRITES.sub("", made_by) in shown | quoted


@pytest.mark.parametrize("name", NAMES)
def test_a_record_is_the_same_wherever_and_whenever_it_is_written(name):
    text = (FOLDER / f"{name}.json").read_text(encoding="utf-8")
    assert not re.search(r"\s/\w|20\d\d-\d\d-\d\d", text)


def test_the_hand_is_drawn_of_the_robot_that_the_quick_start_has_now():
    assert records.record_of(front_page.HAND)["shown"] == front_page.hand_shown(None)


def _same(before, now):
    """Compare texts of which digits that noise moves may differ."""
    assert NUMBER.sub("#", before) == NUMBER.sub("#", now)
    old, new = (
        [float(number.replace("−", "-")) for number in NUMBER.findall(text)]
        for text in (before, now)
    )
    assert old == pytest.approx(new, rel=0.1, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("still", pictures.STILLS, ids=lambda still: still.name)
def test_a_command_writes_now_what_its_picture_shows(still, monkeypatch):
    if still.drawn.endswith(".html") and first_screen.CHROMIUM is None:
        pytest.skip("neither chromium nor google-chrome is installed")
    shared = ROOT.parent / "shared/data/strangers"
    monkeypatch.setenv("BUTTERFLY_STRANGERS", os.environ.get("BUTTERFLY_STRANGERS") or str(shared))
    folder = still.run()
    if folder is None:
        pytest.skip(f"the logs of {still.name} are not there (BUTTERFLY_STRANGERS)")
    now, before = still.record(folder), records.record_of(still.name)
    for part in ("shown", "quoted"):
        _same(str(before[part]), str(now[part]))


@pytest.mark.slow
def test_the_log_of_the_front_page_is_followed_now_as_its_picture_shows():
    now = front_page.fit_shown(pictures.quickstart() / pictures.QUICK, None)
    _same(_seen(front_page.LOG), "\n".join(now))
