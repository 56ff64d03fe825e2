"""What users write is neither markup nor a formula, and no absurd number fills the memory."""

import pyarrow as pa
import pytest
import yaml

from butterfly.cli.output import ExitCode
from butterfly.cli.results import without_formulas
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
