"""The commands that show, draw and export the robot."""

import re

import mujoco
import numpy as np
import pytest
import yaml
from PIL import Image

from butterfly.experiment.simulation import simulate, write_logs
from butterfly.experiment.source import read_experiment
from butterfly.files import shipped
from butterfly.plant.robot import HAND_MASS, Robot
from butterfly.plant.watch.picture import Painter, RenderingError
from tests.cli.one_line import assert_one_line_error
from tests.conftest import MASSES, ROBOT


def test_the_model_of_an_experiment_is_shown_and_exported(butterfly, tmp_path):
    code, out, _ = butterfly("model", "show", "quickstart", "--added-mass", 0.05)
    assert code == 0
    assert "5.1306 rad/s" in out
    assert "mass 0.1 kg, com_distance 0.05 m, inertia 0.003 kg m²" in out
    assert re.search(r"p4 +0\.025 N m/V", out)
    code, out, _ = butterfly("model", "export", "quickstart", "--out", tmp_path / "q.xml")
    assert code == 0
    assert f"Model: {tmp_path / 'q.xml'}, with steps of 1 ms" in out
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "q.xml"))
    assert model.dof_damping[0] == 2e-4


def test_the_twin_of_a_data_set_is_exported_and_moves_as_identified(
    butterfly, quick_data, tmp_path
):
    code, out, _ = butterfly("model", "export", quick_data, "--out", tmp_path / "t.xml")
    assert code == 0
    assert "left out" not in out  # of the few microseconds that were found where there are none
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "t.xml"))
    data = mujoco.MjData(model)
    data.qpos[0], data.ctrl[0] = 0.5, 1.0
    mujoco.mj_forward(model, data)
    inertia = np.zeros((1, 1))
    mujoco.mj_fullM(model, data, inertia)
    assert inertia[0, 0] == pytest.approx(0.00325, rel=0.02)
    assert data.qfrc_bias[0] == pytest.approx(0.04905 * np.sin(0.5), rel=0.02)
    assert data.qfrc_actuator[0] == pytest.approx(0.025, rel=0.02)


@pytest.fixture(scope="module")
def heavy_data(tmp_path_factory):
    """Logs of an ordinary joint: no hand of 0.3 kg has its p1 and p3."""
    content = yaml.safe_load(shipped("experiments/quickstart.yaml").read_text())
    lumped = {"p1": 0.012, "p2": 0.02, "p3": 0.62, "p4": 1.0}
    sines = [{"omega": omega, "amplitude": 0.05} for omega in (4.0, 6.0, 7.5, 9.0)]
    masses = [{"mass": 0.0}, {"mass": 0.1, "arm": 0.104}]
    content |= {"duration": 12.0, "excitations": sines, "added_masses": masses}
    content["plant"] = {"lumped": lumped, "simulator": "grey-box"}
    folder = tmp_path_factory.mktemp("heavy")
    (folder / "heavy.yaml").write_text(yaml.safe_dump(content))
    experiment = read_experiment(folder / "heavy.yaml")
    return write_logs(experiment, simulate(experiment), folder / "data").parent


def test_a_hand_gets_a_mass_that_its_parameters_allow(butterfly, heavy_data, tmp_path):
    code, out, err = butterfly("model", "export", heavy_data, "--out", tmp_path / "t.xml")
    assert code == 0, err
    assert "(--hand-mass)" in out
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "t.xml"))
    hand = model.body("hand").id
    about = model.body_inertia[hand, 0] + model.body_mass[hand] * model.body_ipos[hand, 2] ** 2
    assert about == pytest.approx(0.012, rel=0.02)


def test_a_mass_that_the_parameters_do_not_allow_is_refused_by_its_option(butterfly, heavy_data):
    ran = butterfly("model", "show", heavy_data, "--hand-mass", 0.3)
    assert_one_line_error(ran, "--hand-mass", "0.33")


def test_what_an_exported_model_cannot_do_is_said(butterfly, quick, tmp_path):
    content = yaml.safe_load(quick.read_text())
    content["plant"]["path"] = {"resolution": 0.01, "delay": 0.0021, "limit": 5.0}
    quick.write_text(yaml.safe_dump(content))
    code, out, _ = butterfly("model", "export", quick, "--out", tmp_path / "t.xml")
    assert code == 0
    assert "MuJoCo does not round commands" in out
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "t.xml"))
    assert model.actuator("motor").ctrlrange[1] == 5.0
    assert model.nhistory > 0


def test_what_is_neither_experiment_nor_data_set_is_refused(butterfly, tmp_path):
    path = tmp_path / "other.yaml"
    path.write_text("colour: blue")
    assert_one_line_error(butterfly("model", "show", path), path, "colour")


def test_the_robot_is_drawn_and_turns_with_its_angle(butterfly, tmp_path):
    try:
        with Painter(Robot.of_lumped(ROBOT, HAND_MASS), MASSES[1], 32):
            pass
    except RenderingError as missing:
        pytest.skip(str(missing))
    pictures = []
    for name, angle in (("one", 0.0), ("same", 0.0), ("other", 1.2)):
        out = tmp_path / f"{name}.png"
        told = ("--angle", angle, "--size", 96, "--added-mass", 0.05, "--out", out)
        code, said, err = butterfly("model", "render", "quickstart", *told)
        assert code == 0, err
        assert f"Picture: {out}" in said
        pictures.append(np.asarray(Image.open(out).convert("RGB"), dtype=float))
    one, same, other = pictures
    assert one.shape == (96, 96, 3)
    np.testing.assert_array_equal(one, same)
    assert np.abs(other - one).mean() > 0.5


def test_the_twin_of_a_folder_without_manifest_needs_its_arm_and_carries_masses_there(
    butterfly, logs_folder
):
    assert_one_line_error(butterfly("model", "show", logs_folder), "--arm")
    added = ("--added-mass", 0.052, "--arm", 0.1)
    code, out, err = butterfly("model", "show", logs_folder, *added)
    assert code == 0, err
    assert "52 g at 100 mm" in out
