"""Values of options: lists and pairs by commas, and options as words of a further command."""

import numpy as np
import pytest
import yaml

from butterfly.cli.options import (
    DataOptions,
    parse_names,
    parse_numbers,
    parse_pairs,
    parse_positions,
)
from butterfly.errors import InputError
from tests.cli.one_line import assert_one_line_error, done

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


def test_faults_to_repair_are_given_with_commas_or_one_by_one(butterfly, tmp_path):
    table = np.column_stack([np.arange(60) / 100] * 3)
    header = "time,input,angle"
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=header, comments="")
    for words in (("--repair", "unwrap,backward"), ("--repair", "unwrap", "--repair", "backward")):
        done(butterfly("manifest", tmp_path, *words, "--overwrite"))
        written = yaml.safe_load((tmp_path / "manifest.yaml").read_text())
        assert written["repair"] == ["backward", "duplicate", "unwrap"]
    said = butterfly("manifest", tmp_path, "--repair", "unwrap,upwrap")
    assert_one_line_error(said, "--repair", "upwrap", "'unwrap'")
