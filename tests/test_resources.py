from pathlib import Path

import pytest

from butterfly.errors import InputError
from butterfly.resources import locate, shipped, shipped_experiments


def test_the_robot_and_the_quick_start_are_shipped():
    assert shipped("models/butterfly_hand/hand.xml").is_file()
    assert "experiments/quickstart.yaml" in shipped_experiments()


@pytest.mark.parametrize("name", ["quickstart", "quickstart.yaml", "experiments/quickstart.yaml"])
def test_a_shipped_experiment_is_found_by_any_of_its_names_from_anywhere(
    name, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert locate(Path(name)) == shipped("experiments/quickstart.yaml")


def test_a_file_of_the_user_s_own_comes_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("quickstart.yaml").touch()
    assert locate(Path("quickstart.yaml")) == Path("quickstart.yaml")


def test_an_unknown_name_is_answered_with_the_known_ones(tmp_path):
    with pytest.raises(InputError, match=r"experiments/quickstart\.yaml"):
        locate(tmp_path / "nowhere.yaml")
    with pytest.raises(InputError, match="no such shipped file"):
        shipped("models/nowhere.xml")
