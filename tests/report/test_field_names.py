"""Fields of an experiment are named in words, with their units."""

from butterfly.experiment.schema import Experiment
from butterfly.report.field_names import _UNITS, said_field, said_name

PURE = {
    *("repetitions", "seed", "register", "power", "multiplier", "rounds", "workers", "folds"),
    *("dropped", "duplicated", "worst", "count", "decimation", "cogging_periods"),
}


def test_a_field_is_named_without_its_root_and_with_its_unit():
    assert said_field("plant.friction.coulomb") == "friction coulomb, N m"
    assert said_field("plant.encoder.noise") == "encoder noise, rad"
    assert said_field("added_masses.1.mass") == "added masses 1 mass, kg"
    assert said_name("fit_median") == "fit median"


def test_the_numbers_of_the_plant_have_units():
    schema = Experiment.model_json_schema()["$defs"]
    parts = ("Hand", "VoltageDrive", "TorqueDrive", "Friction", "Clutch", "Clock", "Encoder")
    names = {
        name
        for part in parts
        for name, field in schema[part]["properties"].items()
        if field.get("type") in {"number", "integer"}
    }
    assert names - PURE <= set(_UNITS)
