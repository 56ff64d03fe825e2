"""What no machine can do, and no folder be called, is refused in a line before it is begun."""

import pyarrow as pa
import pytest
import yaml

from butterfly.cli.output import ExitCode
from butterfly.cli.sweeps import without_formulas
from butterfly.errors import InputError, memory, require_room, size_text
from butterfly.experiment.source import read_experiment
from butterfly.experiment.sweep_spec import SweepSpec
from butterfly.files import is_name

TOO_MUCH = {
    "a duration": ({"duration": 1e12}, r"duration: got 1e\+12 s; expected less: it takes .* EB|PB"),
    "harmonics": (
        {"signals": [{"multisine": {"base": 1.0, "harmonics": [1, 2_000_000_000], "peak": 0.1}}]},
        r"harmonics: got 2000000000; expected less: it takes 1\.3 TB of memory",
    ),
    "an encoder": (
        {"plant": {"encoder": {"steps": 10**400}}},
        r"encoder\.steps: got more; expected 1 to 1152921504606846976 steps per turn",
    ),
}
NAMELESS = ("..", "...", "nul", "COM1.yaml", "x" * 101)


def _changed(quick, changes):
    content = yaml.safe_load(quick.read_text())
    plant = content["plant"] | changes.pop("plant", {})
    quick.write_text(yaml.safe_dump(content | {"plant": plant} | changes))
    return quick


@pytest.mark.parametrize("what", TOO_MUCH)
def test_what_does_not_fit_into_memory_is_refused_with_its_bytes(quick, what):
    changes, message = TOO_MUCH[what]
    with pytest.raises(InputError, match=message):
        read_experiment(_changed(quick, dict(changes)))


def test_a_plan_that_no_memory_holds_is_refused_before_it_is_made():
    sweep = SweepSpec(grid={"seed": list(range(1000))}, repetitions=10**9)
    with pytest.raises(
        InputError, match="sweep: got 1,000,000,000,000 runs; expected less: it takes 2"
    ):
        next(iter(sweep.points(0)))


@pytest.mark.parametrize("name", NAMELESS)
def test_a_name_is_the_name_of_a_folder(quick, name):
    assert not is_name(name)
    with pytest.raises(InputError, match="a name that a folder can have, of up to 100 characters"):
        read_experiment(_changed(quick, {"name": name}))


@pytest.mark.parametrize("path", ["a\0b.csv", "a" * 5000])
def test_a_path_is_one_that_a_file_system_takes(quick, path):
    table = {"file": {"path": path}}
    for changes in ({"signals": [table]}, {"extends": path}):
        with pytest.raises(InputError, match="expected a path"):
            read_experiment(_changed(quick, dict(changes)))


def test_room_is_that_of_the_machine():
    require_room("test", "size", 1, memory())
    with pytest.raises(InputError, match="it takes inf EB of memory"):
        require_room("test", "size", 1, float("inf"))
    assert [size_text(size) for size in (17, 1.5e3, 2.4e12)] == ["17 bytes", "1.5 kB", "2.4 TB"]


def test_texts_are_no_markup(butterfly, quick_data, tmp_path):
    manifest = yaml.safe_load((quick_data / "manifest.yaml").read_text())
    name = "a[/b][red]:smile:"
    told = manifest | {"name": name, "root": str(quick_data)}
    (tmp_path / "manifest.yaml").write_text(yaml.safe_dump(told))
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
