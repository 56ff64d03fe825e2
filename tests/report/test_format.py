"""Numbers with the digits that their errors leave; fields of an experiment in words."""

import math

import pytest

from butterfly.experiment.schema import Experiment
from butterfly.report.format import (
    field_label,
    field_name,
    field_unit,
    fit_text,
    interval,
    with_error,
)

PURE = {
    *("repetitions", "seed", "register", "power", "multiplier", "rounds", "workers", "folds"),
    *("dropped", "duplicated", "worst", "count", "decimation", "cogging_periods"),
}


@pytest.mark.parametrize(
    ("path", "label"),
    [
        ("plant.friction.coulomb", "friction coulomb in N m"),
        ("plant.encoder.noise", "encoder noise in rad"),
        ("added_masses.1.mass", "added masses 1 mass in kg"),
        ("fit_median", "fit median in %"),
    ],
)
def test_a_field_is_named_without_its_root_and_with_its_unit(path, label):
    assert field_label(path) == label
    assert label.startswith(field_name(path))


def test_the_numbers_of_the_plant_have_units():
    schema = Experiment.model_json_schema()["$defs"]
    parts = ("Hand", "VoltageDrive", "TorqueDrive", "Friction", "Clutch", "Clock", "Encoder")
    names = {
        name
        for part in parts
        for name, field in schema[part]["properties"].items()
        if field.get("type") in {"number", "integer"}
    }
    assert all(field_unit(f"plant.{name}") for name in names - PURE)


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (2.4771657, 0.0317, "2.477"),
        (0.0020999, 2.8e-5, "0.002100"),
        (-0.00016051, 0.0011, "-0.00016"),
        (123.4, 1.2, "123.4"),
        (1234.0, 12.0, "1234"),
        (0.5, float("nan"), "0.5"),
        (0.0, 0.1, "0"),
        (-1.0e-5, 0.0011, "-1e-05"),
        (float("nan"), 0.1, "–"),
    ],
)
def test_values_are_written_to_the_second_digit_of_their_error(value, error, text):
    assert with_error(value, error) == text


def test_an_unknown_fit_is_a_dash_and_a_poor_one_is_bounded():
    assert [fit_text(fit) for fit in (math.nan, -2000.0, 99.26)] == ["–", "less than -1000", "99.3"]


def test_an_interval_without_limits_is_a_dash():
    assert interval(float("nan"), 1.0) == "–"
    assert interval(1.0, 2.0) == "[1.00, 2.00]"
