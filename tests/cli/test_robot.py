"""The robot: watched, drawn, told and exported."""

import json
import re

import mujoco
import numpy as np
import pytest
import yaml
from PIL import Image
from scipy.io import loadmat

import butterfly as bf
from butterfly.cli.output import ExitCode
from butterfly.errors import InputError
from butterfly.plant.watch import picture
from tests.cli.one_line import assert_one_line_error, done
from tests.experiment.setting import changed
from tests.plant.setting import skip_where_nothing_is_drawn


@pytest.fixture
def painted(monkeypatch):
    """Angles that are drawn, in place of the pictures."""
    angles = []

    class Painter:
        def __init__(self, _robot, _added, size):
            self.size = size

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def frame(self, angle, ghost=None):
            angles.append(angle if ghost is None else (angle, ghost))
            return Image.new("RGB", (self.size, self.size), (len(angles), 0, 0))

    monkeypatch.setattr(picture, "Painter", Painter)
    return angles


ROUGH = {
    "simulator": "grey-box",
    "clock": {"step": 0.002, "jitter": 0.0003},
    "path": {"limit": 0.02, "delay": 0.003},
    "faults": {"dropped": 0.01},
}


@pytest.mark.parametrize("changes", [{"path": {"limit": 0.02}}, ROUGH])
def test_a_film_draws_the_log_that_simulate_writes(
    butterfly, quick_in_mujoco, tmp_path, painted, changes
):
    plant = yaml.safe_load(quick_in_mujoco.read_text())["plant"] | changes
    experiment = changed(quick_in_mujoco, duration=4.0, seed=7, plant=plant)
    film = tmp_path / "hand.gif"
    asked = ("--run", 3, "--seconds", 3, "--fps", 20, "--size", 32)
    code, out, _ = butterfly("show", experiment, "--out", film, *asked)
    assert (code, out) == (0, f"Film: {film}\n")
    assert butterfly("simulate", experiment, "--out", tmp_path / "logs")[0] == 0
    (path,) = (tmp_path / "logs").glob("run003_*.mat")
    time, _, angle, _ = loadmat(path)["D"].T
    instants = np.arange(time[0], time[time <= time[0] + 3][-1], 1 / 20)
    np.testing.assert_array_equal(painted, np.interp(instants, time, angle))
    assert np.ptp(painted) > 0.01
    with Image.open(film) as picture:
        assert (picture.n_frames, picture.size) == (len(painted), (32, 32))


def test_a_robot_is_drawn_and_turns_with_its_angle(butterfly, saved, tmp_path):
    """Be it an experiment's or an identified one."""
    skip_where_nothing_is_drawn()
    pictures = []
    quick, path = "quickstart", tmp_path / "drawn.png"
    for source, added, angle in (
        *((quick, 0.0, 0.8), (quick, 0.05, 0.8), (saved, 0.05, 0.8), (saved, 0.05, -0.8)),
    ):
        asked = ("--added-mass", added, "--angle", angle, "--size", 96)
        out = done(butterfly("show", source, "--out", path, *asked))
        assert f"Picture: {path}\n" in out
        with Image.open(path) as picture:
            pictures.append(np.asarray(picture.convert("RGB")).astype(int))
    bare, right, too, left = (np.argwhere(p[..., 0] - p[..., 2] > 60) for p in pictures)
    assert bare.size == 0
    assert left[:, 1].mean() < 48 < right[:, 1].mean()  # of the pivot
    assert too[:, 1].mean() == pytest.approx(right[:, 1].mean(), abs=2)
    assert pictures[0].shape == (96, 96, 3)


@pytest.mark.usefixtures("brief_twins")
def test_the_robot_of_an_experiment_is_told_and_exported(answer, quick, tmp_path):
    out = done(answer("inspect", "quickstart", "--added-mass", 0.05))
    assert "5.1306 rad/s" in out
    assert "mass 0.1 kg, com_distance 0.05 m, inertia 0.003 kg m²" in out
    assert re.search(r"p4 +0\.025 N m/V", out)
    path = {"resolution": 0.01, "delay": 0.0021, "limit": 5.0}
    plant = yaml.safe_load(quick.read_text())["plant"] | {"path": path}
    changed(quick, plant=plant, duration=4.0, excitations=[{"omega": 3.0, "amplitude": 0.2}])
    out = done(answer("export", quick, "--out", tmp_path / "q.xml"))
    twin = rf"Twin: {tmp_path / 'q.xml'}, the butterfly's hand in steps of \S+ ms by RK4\."
    said = " ".join(out.split())
    assert re.match(rf"{twin} Ready to use, within the limits below\.", said)
    assert "Largest error against our own simulation: " in out
    assert "MuJoCo does not round commands" in out
    assert "Next: " not in out
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "q.xml"))
    assert model.dof_damping[0] == 2e-4
    assert model.actuator("motor").ctrlrange[1] == 5.0
    assert model.nhistory > 0


def test_a_servo_is_exported_for_bam(answer, tmp_path):
    asked = ("--to", "bam", "--out", tmp_path / "s.json")
    out = done(answer("export", "servo", *asked))
    told = json.loads((tmp_path / "s.json").read_text())
    assert f"BAM's {told['model']} of xl330" in out
    assert all(sentence in " ".join(out.split()) for sentence in told["notes"])
    other = ("--to", "bam", "--out", tmp_path / "other.json")
    assert_one_line_error(answer("export", "quickstart", *other), "--actuator")
    assert_one_line_error(
        answer("export", "servo", "--actuator", "mx64", "--out", tmp_path / "t.xml"), "--to bam"
    )


@pytest.mark.usefixtures("brief_twins")
def test_export_says_first_what_was_written_and_whether_to_use_it_then_how_good_it_is(
    butterfly, saved, tmp_path
):
    first, second, third, *_ = done(
        butterfly("export", saved, "--out", tmp_path / "t.xml")
    ).splitlines()
    assert first.startswith(f"Twin: {tmp_path / 't.xml'}, ")
    assert first.endswith(" Ready to use.")
    assert second.startswith("Good: p1 ±")
    assert third.startswith("Model: ")


def test_what_cancels_a_joint_is_exported_with_its_error(butterfly, answer, saved, quick, tmp_path):
    out = done(butterfly("export", saved, "--to", "compensation", "--out", tmp_path / "c.h"))
    assert "Compensation: " in out
    assert re.search(r"Error at most \S+ V \(\S+ N m\) of up to", out)
    first = " ".join((tmp_path / "c.h").read_text().split("*/")[0].split())
    assert re.search(r"Cancels gravity, .*?\.", " ".join(out.split()))[0] in first
    out = done(answer("export", quick, "--to", "compensation", "--out", tmp_path / "c.py"))
    assert "taken as exact" in out
    assert "def command(angle, velocity" in (tmp_path / "c.py").read_text()
    done(butterfly("export", saved, "--to", "wpilib", "--out", tmp_path / "g.json"))
    assert json.loads((tmp_path / "g.json").read_text())["class"] == "ArmFeedforward"


@pytest.mark.filterwarnings("ignore:.*(Ranges|Isaac Lab|Events)")
def test_results_of_several_units_are_exported_as_ranges(butterfly, saved, tmp_path):
    paths = [saved, *(tmp_path / f"unit{number}.json" for number in (2, 3))]
    for number, path in enumerate(paths[1:], 2):
        content = json.loads(saved.read_text())
        content["parameters"]["p2"]["value"] *= number
        del content["digest"]
        path.write_text(json.dumps(content))
    asked = ("--to", "randomisation", "--out", tmp_path / "ranges.yaml")
    out = " ".join(done(butterfly("export", *paths, *asked)).split())
    assert "mean of 3 units ± 9.99 standard deviations" in out
    assert "Next: " not in out
    rows = yaml.safe_load((tmp_path / "ranges.yaml").read_text())["ranges"]
    (damping,) = (row for row in rows if row["attribute"] == "damping")
    assert damping["deviation"] == pytest.approx(damping["value"] / 2, rel=1e-4)
    again = (*asked[:-1], tmp_path / "again.yaml")
    assert_one_line_error(butterfly("export", saved, saved, *again), "twice", "each unit once")
    other = ("--to", "urdf", "--out", tmp_path / "t.urdf")
    assert_one_line_error(butterfly("export", *paths, *other), "--to randomisation")
    result, unit = (bf.load(path) for path in paths[:2])
    with pytest.raises(InputError, match="randomisation"):
        result.model.export(tmp_path / "t.urdf", to="urdf", others=[unit])
    written = result.model.export(tmp_path / "r.py", to="randomisation", others=[unit])
    assert "mean of 2 units" in written.text


def test_ranges_of_a_unit_that_is_not_to_be_used_end_with_its_verdict(
    butterfly, saved, unfit, tmp_path
):
    content = json.loads(saved.read_text())
    content["parameters"]["p2"]["value"] *= 2
    del content["digest"]
    (tmp_path / "unit.json").write_text(json.dumps(content))
    for number, others in enumerate(([], [tmp_path / "unit.json"])):
        asked = ("--to", "randomisation", "--out", tmp_path / f"{number}.yaml")
        code, out, _ = butterfly("export", unfit, *others, *asked)
        assert code == ExitCode.NOT_TO_BE_USED
        first, second, *_ = out.splitlines()
        assert re.fullmatch(r"Ranges: .*\. Do not use\.", first)
        assert second.startswith("Do not use: ")


@pytest.mark.usefixtures("brief_twins")
def test_a_hand_gets_a_mass_that_its_parameters_allow_and_no_other(butterfly, saved, tmp_path):
    """No hand of 0.3 kg has the p1 and p3 of an ordinary joint."""
    content, heavy = json.loads(saved.read_text()), tmp_path / "heavy.json"
    for name, value in {"p1": 0.012, "p2": 0.02, "p3": 0.62, "p4": 1.0}.items():
        content["parameters"][name]["value"] = value
    del content["digest"]
    heavy.write_text(json.dumps(content))
    out = done(butterfly("export", heavy, "--out", tmp_path / "t.xml"))
    assert "(change: export --hand-mass)" in out
    assert out.splitlines()[-1] == f"Next: butterfly compare {heavy}"
    out = done(butterfly("export", heavy, "--out", tmp_path / "t.xml", "--added-mass", 0.05))
    assert "by RK4, with 50 g at 104 mm." in " ".join(out.split())
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "t.xml"))
    hand = model.joint("hinge").bodyid[0]
    about = model.body_inertia[hand, 0] + model.body_mass[hand] * model.body_ipos[hand, 2] ** 2
    assert about == pytest.approx(0.012, rel=0.02)
    ran = butterfly("export", heavy, "--out", tmp_path / "t.xml", "--hand-mass", 0.3)
    assert_one_line_error(ran, "--hand-mass", "0.33")


def test_what_is_neither_experiment_nor_data_set_is_refused(answer, tmp_path):
    path = tmp_path / "other.yaml"
    path.write_text("colour: blue")
    assert_one_line_error(answer("inspect", path), path, "colour")


def test_a_log_is_drawn_beside_its_free_run(butterfly, saved, tmp_path, painted):
    film, still, other = (tmp_path / name for name in ("log.gif", "log.png", "other.gif"))
    result = bf.load(saved)
    out = done(butterfly("show", saved, "--log", 2, "--out", film, "--seconds", 1, "--fps", 10))
    assert out.startswith("Good: p1 ±")
    assert out.endswith(f"Film: {film}\n")
    measured, simulated = zip(*painted, strict=True)
    run = result.free_runs[2]
    at = run.log.time[0] + 0.1 * np.arange(len(painted))
    np.testing.assert_allclose(measured, np.interp(at, run.log.time, run.log.angle))
    np.testing.assert_allclose(simulated, np.interp(at, run.log.time, run.simulated))
    done(butterfly("show", saved, "--log", 2, "--out", still))
    worst = np.argmax(abs(run.simulated - run.log.angle))
    assert painted[-1] == (run.log.angle[worst], run.simulated[worst])
    for asked, message in (
        (("show", saved, "--log", 99, "--out", other), "got 99; expected a number from 0 to 8"),
        (("show", saved, "--log", 1), "--out: got missing"),
        (("show", saved), "--out"),
        (("show", "quickstart", "--run", 24, "--out", other), "--run: got 24"),
        (("show", "quickstart", "--log", 1, "--out", other), "a saved result"),
    ):
        assert_one_line_error(butterfly(*asked), message)
