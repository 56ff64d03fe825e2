from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.identification.data import DataSet, read_data_set
from butterfly.logs.log import Log
from butterfly.logs.manifest import read_manifest
from butterfly.logs.mat import write_mat
from butterfly.logs.reading import with_unique_names


def _names(log, names):
    return [each.name for each in with_unique_names([replace(log, name=name) for name in names])]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (["a", "b"], ["a", "b"]),
        (["a", "a", "b", "a"], ["a", "a (2)", "b", "a (3)"]),
        (["a", "a", "a (2)", "a"], ["a", "a (3)", "a (2)", "a (4)"]),
        (["", ""], ["50 g, 5 rad/s", "50 g, 5 rad/s (2)"]),
        (["", "50 g, 5 rad/s"], ["50 g, 5 rad/s", "50 g, 5 rad/s (2)"]),
        ([], []),
    ],
)
def test_logs_get_names_that_differ_the_first_of_a_name_keeps_it(sine_log, given, expected):
    assert _names(sine_log, given) == expected


@given(names=st.lists(st.sampled_from(["", "a", "a (2)", "a (3)", "a (2) (2)"]), max_size=12))
def test_names_are_unique_and_stay_when_they_are(sine_log, names):
    named = _names(sine_log, names)
    assert len(set(named)) == len(named)
    assert _names(sine_log, named) == named
    assert set(filter(None, names)) <= set(named)


def test_a_file_listed_twice_gives_two_logs_of_different_names(tmp_path, sine_log):
    write_mat(sine_log, tmp_path / "a.mat")
    entry = "{file: a.mat, added_mass: 0.05, omega: 5, amplitude: 0.2}"
    (tmp_path / "m.yaml").write_text(
        f"name: m\ninput: voltage\narm: 0.1\nlogs:\n  - {entry}\n  - {entry}\n"
    )
    data = read_data_set(read_manifest(tmp_path / "m.yaml"))
    assert [log.name for log in data.logs] == ["a.mat", "a.mat (2)"]
    assert [log.name for log in data.recorded] == ["a.mat", "a.mat (2)"]
    assert {log.source for log in data.logs} == {str(tmp_path / "a.mat")}


def test_a_name_survives_repairs(sine_log):
    time = sine_log.time.copy()
    time[7] = time[6]
    data = DataSet.of([replace(sine_log, time=time, name="mine"), sine_log])
    assert [log.name for log in data.logs] == ["mine", "50 g, 5 rad/s"]


def test_columns_of_different_lengths_are_refused(sine_log):
    with pytest.raises(InputError, match=r"sine: angle: got shape \(3,\)"):
        replace(sine_log, angle=np.zeros(3))


def test_roughness_is_the_share_of_noise_and_not_of_rare_steps():
    time = np.arange(0, 20, 5e-3)
    noise = np.random.default_rng(0).standard_normal(time.size)
    smooth, stairs = np.sin(3 * time), np.sign(np.sin(time))

    def roughness(inputs):
        return Log(time=time, input=inputs, angle=smooth).roughness

    assert roughness(smooth + 0.1 * noise) == pytest.approx(0.14, rel=0.1)
    assert roughness(smooth) < 1e-3
    assert roughness(stairs) == roughness(0.0 * time) == 0.0
