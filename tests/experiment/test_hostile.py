"""What users write is neither markup nor a formula, and no absurd number fills the memory."""

import json

import pyarrow as pa
import pytest
import yaml

from butterfly.cli.output import ExitCode
from butterfly.cli.results import without_formulas
from butterfly.errors import InputError
from butterfly.experiment.source import Source
from butterfly.experiment.sweep import plan_sweep
from butterfly.files import shipped
from tests.cli.one_line import assert_one_line_error
from tests.experiment.setting import written


def test_texts_are_no_markup(butterfly, quick_data, tmp_path):
    manifest = yaml.safe_load((quick_data / "manifest.yaml").read_text())
    name = "a[/b][red]:smile:"
    written(tmp_path / "manifest.yaml", **manifest | {"name": name, "root": str(quick_data)})
    for command in ("identify", "inspect"):
        code, out, err = butterfly(command, tmp_path)
        assert (code, err) == (ExitCode.DONE, "")
        assert name in out or command == "inspect"


@pytest.mark.slow
@pytest.mark.parametrize("told", ["p1=1e-9,p3=1e9,p4=1", "p1=1e300,p3=1,p4=1"])
def test_absurd_parameters_are_compared_without_filling_the_memory(butterfly, quick_data, told):
    code, out, err = butterfly("identify", quick_data, "--against", told)
    assert (code, err) == (ExitCode.DONE, "")
    assert told in out


def test_a_resonance_that_no_sample_shows_is_refused_where_the_best_p4_is_sought(
    butterfly, quick_data
):
    code, _, err = butterfly("identify", quick_data, "--against", "p1=1e-9,p3=1e9")
    assert code == ExitCode.BAD_INPUT
    assert "p3: got a resonance of 1e+09 rad/s; expected at most the" in err


def test_no_text_of_an_export_is_a_formula():
    table = pa.table({"name": ["=1+1", "plain", None, "@x", "-2"], "value": [-1.0, 2, 3, 4, 5]})
    found = without_formulas(table)
    assert found.column("name").to_pylist() == ["'=1+1", "plain", None, "'@x", "'-2"]
    assert found.column("value").to_pylist() == [-1.0, 2, 3, 4, 5]


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("plant", {"hand": {"com_distance": 1e155}}, "got numbers of which nothing can be calc"),
        ("added_masses", [{"mass": 0.1, "arm": 1e155}], "got numbers of which nothing can be calc"),
        ("plant", {"clock": {"step": 1e5}}, "plant.clock.step: got 100000.0; expected up to 3.75"),
        ("plant", {"hand": {"inertia": 0}}, "inertia: got 0"),
        ("duration", 1e155, "expected less: it takes 6.4e"),
        ("known", {"p4": 10**400}, "known.p4: got 1000"),
    ],
)
def test_numbers_that_no_robot_has_are_one_line_before_anything_is_simulated(
    tmp_path, key, value, said
):
    whole = yaml.safe_load(shipped("experiments/quickstart.yaml").read_text())
    inner = whole.get(key)
    if inner and isinstance(value, dict):
        value = inner | {k: inner.get(k, {}) | each for k, each in value.items()}
    path = written(tmp_path / "absurd.yaml", **whole | {key: value})
    with pytest.raises(InputError) as caught:
        plan_sweep(Source(path))
    assert "absurd.yaml" in str(caught.value)
    assert said in str(caught.value)


@pytest.mark.parametrize("damage", ["short", "missing", "lopsided"])
def test_a_saved_result_with_errors_unlike_its_parameters_is_one_line(
    butterfly, quick_data, tmp_path, damage
):
    file = tmp_path / "saved.json"
    butterfly("identify", quick_data, "--method", "weak-form", "--save", file)
    content = json.loads(file.read_text())
    freedom = content["freedom"]
    content["freedom"] = freedom[:-1] if damage == "short" else [None, *freedom[1:]]
    if damage == "lopsided":
        content["freedom"], content["covariance"]["matrix"][0][1] = freedom, None
    other = tmp_path / "other.json"
    other.write_text(json.dumps(content))
    assert_one_line_error(butterfly("compare", file, other), "other.json" * (damage != "missing"))
