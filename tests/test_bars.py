"""What is asked of the benchmarks: the page has it, and a miss is called so and has a ceiling."""

import pytest

from tests.benchmarks import page
from tests.benchmarks.bars import BARS, Bar


def test_the_page_has_each_bar_and_no_other():
    rows = page.rows().values()
    assert [(row[0], row[2], row[3]) for row in rows] == [
        (what, str(bar), bar.of) for what, bar in BARS.items()
    ]


BEYOND = {
    "free run and FIT of 41 logs",
    "butterfly identify, quick start",
    "what --report adds to it",
    "output error: fit of 12 parameters",
    "mujoco.sysid, 6 logs, 4 parameters: from the logs on",
    "a run in MuJoCo on a jittered clock",
}
"""What is beyond its bar or ceiling today: `make bench` fails; this may only grow shorter."""


def test_a_row_of_the_page_is_called_missed_where_its_figure_is_and_no_other_is_beyond():
    found = [row for row in page.rows().values() if row[1] != "missing"]
    assert [row[4] for row in found] == [BARS[row[0]].note(float(row[1])) for row in found]
    beyond = {row[0]: row[1] for row in found if not BARS[row[0]].holds(float(row[1]), short=False)}
    print("beyond their bars or ceilings:", beyond)
    assert beyond.keys() <= BEYOND


@pytest.mark.parametrize(
    ("bar", "found", "missed", "passes", "passes_the_short_bench"),
    [
        (Bar("≤", 2, "it"), 1.9, False, True, True),
        (Bar("≤", 2, "it"), 3.9, True, False, True),
        (Bar("≤", 2, "it"), 4.1, True, False, False),
        (Bar("≤", 2, "it", today=8), 9.9, True, True, True),
        (Bar("≤", 2, "it", today=8), 10.1, True, False, True),
        (Bar("≤", 2, "it", today=8), 16.1, True, False, False),
        (Bar("≥", 10, "it"), 6, True, False, True),
        (Bar("≥", 10, "it", today=5), 4.1, True, True, True),
        (Bar("≥", 10, "it", today=5), 3.9, True, False, True),
        (Bar("≥", 10, "it", today=5), 2.4, True, False, False),
        (Bar("≤", 2, "it", accuracy=True), 2.1, True, False, False),
        (Bar("≤", None, "it"), 1e9, False, True, True),
    ],
)
def test_a_miss_is_called_so_and_fails_above_its_ceiling(
    bar, found, missed, passes, passes_the_short_bench
):
    assert bar.note(found).startswith("**missed**") == missed
    assert bar.holds(found, short=False) == passes
    assert bar.holds(found, short=True) == passes_the_short_bench


def test_what_misses_its_bar_today_is_worse_than_what_is_asked():
    known = [bar for bar in BARS.values() if bar.today is not None]
    assert known
    assert not any(bar.met(bar.today, bar.asked) for bar in known)


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ('"""Another."""\n\nA = 1  # one\n"""What it is."""\ndef f():\n    return (A)\n', True),
        ('"""It."""\nA = 2\ndef f():\n    "It."\n    return A\n', False),
        ('"""It."""\nA = 1\ndef f():\n    return "It."\n', False),
    ],
)
def test_comments_and_docstrings_do_not_make_the_page_older_than_the_code(text, same, tmp_path):
    module = tmp_path / "module.py"
    module.write_text('"""It."""\nA = 1\ndef f():\n    "It."\n    return A\n', encoding="utf-8")
    before = page.code([tmp_path])
    module.write_text(text, encoding="utf-8")
    assert (page.code([tmp_path]) == before) is same
