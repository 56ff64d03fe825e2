"""The library of motors is listed and shown, and a file for it is drafted from a saved result."""

import json

import pytest

from butterfly.logs.motors import motor_names, motor_of
from butterfly.yaml_files import load_yaml, yaml_text
from tests.cli.one_line import assert_one_line_error, done


def test_every_motor_is_listed_with_its_verdict_and_what_it_knows(answer):
    out = " ".join(done(answer("library", "list")).split())
    assert all(name in out for name in motor_names())
    assert "--known from=NAME" in out
    rows = json.loads(done(answer("library", "list", "--json", "-")))["rows"]
    assert [row["name"] for row in rows] == motor_names()
    assert {row["verdict"] for row in rows} <= {"good", "use with care"}


@pytest.mark.parametrize("name", motor_names())
def test_a_motor_is_shown_with_values_conditions_source_and_licence(answer, name):
    motor, out = motor_of(name), done(answer("library", "show", name))
    assert out.startswith(f"{motor.verdict.capitalize()}: {motor.maker} {motor.name}")
    for measured in motor.motors:
        source = measured.source
        for word in (*motor.known, *measured.rig, source.licence, source.commit[:12]):
            assert word in out
    shown = json.loads(done(answer("library", "show", name, "--json", "-")))
    assert shown["known"].keys() == motor.known.keys()
    assert all(value["uncertainty"] > 0 for value in shown["known"].values())


def test_a_name_that_is_none_is_one_line_with_the_nearest(answer):
    assert_one_line_error(answer("library", "show", "xl33"), "xl33", "did you mean", "xl330")


def test_a_saved_result_becomes_a_file_that_asks_for_what_no_log_says(answer, saved, tmp_path):
    path = tmp_path / "mine.yaml"
    out = done(answer("library", "draft", saved, "--out", path))
    assert f"Next: butterfly library show {path}" in out
    assert_one_line_error(answer("library", "show", path), "mine.yaml:1: name: got ''", "not empty")
    content = load_yaml(path).content
    content |= {"name": "M1", "maker": "Somebody"}
    content["motors"][0]["conditions"] = {"supply": "12 V"}
    content["motors"][0]["source"] = load_motor("xl330")["motors"][0]["source"]
    path = tmp_path / "whole.yaml"
    path.write_text(yaml_text(content))
    assert "Somebody M1, driven by voltage" in done(answer("library", "show", path))
    assert_one_line_error(
        answer("library", "draft", path, "--out", tmp_path / "other.yaml"), "no saved result"
    )


def load_motor(name):
    return motor_of(name).model_dump(mode="json")
