"""Fields of an experiment are named in words, with their units."""

import pytest

from butterfly.experiment.schema import Experiment
from butterfly.report.format import field_label, field_name, field_unit

PURE = {
    *("repetitions", "seed", "register", "power", "multiplier", "rounds", "workers", "folds"),
    *("dropped", "duplicated", "worst", "count", "decimation", "cogging_periods"),
}


@pytest.mark.parametrize(
    ("path", "label"),
    [
        ("plant.friction.coulomb", "friction coulomb, N m"),
        ("plant.encoder.noise", "encoder noise, rad"),
        ("added_masses.1.mass", "added masses 1 mass, kg"),
        ("fit_median", "fit median"),
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
