"""Values of options: lists and pairs by commas, and options as words of a further command."""

import pytest

from butterfly.cli.options import (
    DataOptions,
    parse_names,
    parse_numbers,
    parse_pairs,
    parse_positions,
)
from butterfly.errors import InputError

SAID = DataOptions(
    units="time=ms, angle = -deg", arm=0.1, repair=("unwrap", "backward"), restarts=True, begin=2.5
)


def test_what_is_said_of_data_are_fields_of_a_manifest():
    assert SAID.description() == {
        "units": {"time": "ms", "angle": "-deg"},
        "arm": 0.1,
        "repair": ("unwrap", "backward"),
        "split": "restarts",
        "from": 2.5,
    }
    assert DataOptions().description() == {}


def test_what_is_said_of_data_is_said_again_in_words():
    assert SAID.words() == [
        *("--units", "time=ms, angle = -deg", "--arm", "0.1"),
        *("--repair", "unwrap", "--repair", "backward", "--restarts", "--from", "2.5"),
    ]
    assert DataOptions().words() == []


def test_lists_are_told_apart_by_commas_and_nothing_is_no_list():
    assert parse_names(" drag, ,stribeck") == ("drag", "stribeck")
    assert parse_names("") == parse_names(None) == ()
    assert parse_numbers("0, 12,-1") == [0, 12, -1]
    assert parse_numbers(None) is None


@pytest.mark.parametrize("text", ["time", "time=t,u", ""])
def test_a_pair_without_its_value_is_refused_by_the_name_of_its_option(text):
    with pytest.raises(InputError, match=r"--columns: .*NAME=VALUE"):
        parse_pairs(text, "--columns")


def test_clamped_joints_are_said_and_said_again():
    clamped = DataOptions(clamped=True)
    assert clamped.description() == {"clamped": True}
    assert clamped.words() == ["--clamped"]


def test_positions_are_numbers_by_the_names_of_joints():
    assert parse_positions("wrist=0.5, grip=-1") == {"wrist": 0.5, "grip": -1.0}
    with pytest.raises(InputError, match="wrist: got half; expected a number"):
        parse_positions("wrist=half")
