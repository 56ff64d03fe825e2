"""One name for one thing in all commands, and an old name that names the new one."""

from itertools import groupby

import pytest

from butterfly.cli.lazy import _made
from tests.cli.one_line import assert_one_line_error
from tests.cli.test_app import CALLS, TABLES


def _options(call):
    *group, name = call
    command = _made(name, TABLES["".join(group)][name])
    context = command.make_context(name, [], resilient_parsing=True)
    return [each for each in command.get_params(context) if each.param_type_name == "option"]


@pytest.mark.parametrize(
    ("call", "old", "new"),
    [
        (("compare", "data"), "--logs", "--log"),
        (("compare", "data"), "--mass=0.3", "--hand-mass"),
        (("model", "show", "quickstart"), "--mass", "--hand-mass"),
        (("design", "data"), "--count", "--limit"),
        (("leaderboard", "data"), "--methods", "--method"),
        (("results", "compare", "results/x", "0", "1"), "--against", "--other-results"),
    ],
)
def test_the_former_name_of_an_option_names_the_one_it_has(butterfly, call, old, new):
    assert_one_line_error(butterfly(*call, old, "1"), old.partition("=")[0], f"expected {new}")


def test_an_option_that_kept_its_name_is_no_former_one(butterfly, quick_data):
    code, _, err = butterfly("identify", quick_data, "--against", "p1=0.003,p2=0.001,p3=0.05")
    assert code == 0, err


def test_short_forms_mean_the_same_everywhere():
    meant = {}
    for call in CALLS:
        for option in _options(call):
            for short in (name for name in option.opts if not name.startswith("--")):
                meant.setdefault(short, set()).add(option.opts[0])
    assert meant["-o"] == {"--out"}
    assert meant["-m"] == {"--method"}
    assert meant["-r"] == {"--report"}
    assert all(len(names) == 1 for names in meant.values())


def test_options_of_a_group_stand_together_with_words_for_their_values():
    options = _options(("identify",))
    groups = [option.rich_help_panel for option in options]
    assert {"The fit", "The fit in detail", "The data", "What is written"} <= set(groups)
    assert len({*groups}) == len([*groupby(groups)])
    words = {option.opts[0]: option.metavar for option in options}
    assert (words["--method"], words["--arm"], words["--figures"]) == ("METHOD", "m", "")


def test_a_method_is_named_in_short(butterfly, quick_data, tmp_path):
    report = tmp_path / "r.html"
    code, out, err = butterfly("identify", quick_data, "-m", "linear", "-r", report)
    assert code == 0, err
    assert "joint linear complex fit" in out
    assert report.exists()
