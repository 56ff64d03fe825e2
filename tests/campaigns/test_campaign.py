"""Campaigns with simulated robots of known parameters, sound ones and such as fail."""

from dataclasses import replace

import pytest

import butterfly as bf
from butterfly.campaigns import folder
from butterfly.campaigns.bench import Bench, Relay, Signal
from butterfly.campaigns.drive import SafetyStop
from butterfly.errors import InputError
from butterfly.files import shipped
from butterfly.identification.design import OF_GOAL
from butterfly.plant.rig import Simulator
from butterfly.yaml_files import load_yaml, yaml_text
from tests.campaigns.robots import TRUE, Faulty, rig, run


def test_an_unknown_robot_is_known_to_one_per_cent_after_a_minute(tmp_path):
    found = run(Faulty("reversed"), tmp_path / "a", known=None, step=None)
    estimate = found.identification.estimate
    assert found.content["reached"]
    assert found.content["polarity"] == -1
    assert found.content["changes"] == 1
    assert found.content["robot_time"] < 90
    for name in OF_GOAL:
        assert estimate.named[name] == pytest.approx(getattr(TRUE, name), rel=0.015)
    assert min(found.content["held_out"].values()) > 99


def test_the_same_in_mujoco(tmp_path):
    found = run(Faulty("", of=rig(Simulator.MUJOCO)), tmp_path / "a")
    values = found.identification.estimate.named
    assert found.content["reached"]
    assert all(values[n] == pytest.approx(getattr(TRUE, n), rel=0.015) for n in OF_GOAL)


def test_identify_answers_alike_from_the_folder_and_a_saved_campaign_shows_what_it_showed(tmp_path):
    found = run(Faulty(""), tmp_path / "a")
    again = bf.identify(tmp_path / "a")
    assert again.estimate.named == pytest.approx(found.identification.estimate.named)
    found.save(tmp_path / "saved.json")
    loaded = bf.load(tmp_path / "saved.json")
    assert (str(loaded), loaded.rows()) == (str(found), found.rows())
    assert "shrinking" in found.reports[0].read_text(encoding="utf-8")


def test_a_known_gain_needs_no_change_of_mass(tmp_path):
    found = run(Faulty(""), tmp_path / "a", known={"p4": TRUE.p4})
    assert found.content["reached"]
    assert found.content["changes"] == 0


def test_a_motor_of_the_library_sets_the_scale_and_the_folder_says_whose_values_it_used(tmp_path):
    file = tmp_path / "mine.yaml"
    content = load_yaml(shipped("models/motors/ak80-6.yaml")).content
    gain = {"value": TRUE.p4, "lower": 0.95 * TRUE.p4, "upper": 1.05 * TRUE.p4, "unit": "N m/unit"}
    motor = content["motors"][0] | {"known": {"p4": gain}}
    file.write_text(yaml_text(content | {"motors": [motor]}))
    asked = {"known": {"from": str(file)}, "masses": (0.0,), "seconds": 30.0}
    found = run(Faulty(""), tmp_path / "a", **asked)
    estimate = found.identification.estimate
    assert str(file) in (tmp_path / "a" / "manifest.yaml").read_text()
    (whose,) = estimate.known.parameters.values()
    assert abs(estimate.named["p4"] - TRUE.p4) < 3 * whose.uncertainty < 0.6 * TRUE.p4
    assert any(text.startswith(f"Known from {file} (") for text in found.identification.summary)
    assert run(Faulty(""), tmp_path / "a", **asked).content["robot_time"] > 0


def test_without_a_mass_ratios_are_all_that_is_claimed(tmp_path):
    found = run(Faulty(""), tmp_path / "a", masses=(0.0,), change=None)
    assert not found.content["reached"]
    assert "the ratios to p1 reach the goal" in found.content["ending"]
    assert found.identification.estimate.named["p3"] == pytest.approx(12.5, rel=0.01)


@pytest.mark.parametrize(
    ("owner", "after"),
    [pytest.param(Bench, 1, marks=pytest.mark.slow), (Bench, 2), (folder, 5)],
)
def test_a_campaign_that_was_killed_goes_on_and_ends_alike(tmp_path, monkeypatch, owner, after):
    name = "run" if owner is Bench else "write_file"  # a journal then, before its manifest
    kept, calls = getattr(owner, name), []

    def killed(of, what, *more, **options):
        motor = getattr(getattr(of, "_drive", None), "_motor", None)
        laws = isinstance(motor, Faulty) and isinstance(what, Relay | Signal)
        calls.append(laws or owner is folder)
        if sum(calls) > after:
            raise KeyboardInterrupt
        return kept(of, what, *more, **options)

    monkeypatch.setattr(owner, name, killed)
    motor = Faulty("")
    with pytest.raises(KeyboardInterrupt):
        run(motor, tmp_path / "a")
    assert motor.commands[-1] == 0
    assert motor.stopped
    monkeypatch.undo()
    found = run(Faulty(""), tmp_path / "a")
    assert found.content["reached"]
    assert len(found.rows()) == len(list((tmp_path / "a").glob("*.parquet")))


FAILURES = [
    ("no supply", 0.0, "nothing moves", {}),
    ("no supply", 12.0, "no longer moves", {}),
    pytest.param("loose", 0.0, "no longer moves", {"step": None}, marks=pytest.mark.slow),
    ("one way", 0.0, "both signs", {}),
    ("cable", 12.0, "no number", {}),
    ("frozen", 12.0, "no longer moves|nothing moves", {}),
    ("late", 12.0, "passed between two readings", {}),
    ("back", 12.0, "ran back", {}),
    *[("slips", since, "slips", {}) for since in (14.0, 20.0, 22.0)],
    ("not mounted", 0.0, "not mounted", {}),
    ("mounted once", 0.0, "as it did with 100 g at 100 mm", {"goal": 1e-4, "price": 0.0}),
    *[("current", since, "50 A beyond 10 A", {"current": 10.0}) for since in (0.0, 12.0)],
    ("unplugged", 12.0, "no longer answers", {}),
]


@pytest.mark.parametrize(("wrong", "since", "said", "options"), FAILURES)
def test_what_is_wrong_ends_in_words_with_the_drive_off_and_nothing_lost(
    tmp_path, wrong, since, said, options
):
    motor = Faulty(wrong, since)
    with pytest.raises(SafetyStop, match=said):
        run(motor, tmp_path / "a", **options)
    assert motor.commands[-1] == 0 or wrong == "unplugged"
    assert motor.stopped
    kept = len(list((tmp_path / "a").glob("run_???.parquet"))) if (tmp_path / "a").exists() else 0
    assert kept == (len(bf.read(tmp_path / "a").recorded) if kept else 0)


@pytest.mark.slow
def test_readings_that_end_at_a_stop_are_not_followed_and_no_goal_is_claimed(tmp_path):
    found = run(Faulty("end stop"), tmp_path / "a")
    assert not found.content["reached"]
    assert "no end stop or cable touches the joint" in found.content["ending"]


@pytest.mark.slow
def test_what_the_model_does_not_follow_ends_in_words_after_small_runs(tmp_path):
    found = run(Faulty("fading"), tmp_path / "a", step=None)
    assert not found.content["reached"]
    assert "encoder does not slip, and that no end stop" in found.content["ending"]
    shows = "residual" if found.identification is not None else "inspect"  # what can be shown
    assert f"butterfly {shows}" in str(found)
    assert all("relay of 0.18 rad" in row["played"] for row in found.rows())


def test_where_friction_holds_the_joint_anywhere_it_stays_within_a_tenth_of_its_limit(tmp_path):
    stiff = Faulty("", of=rig(true=replace(TRUE, p3=0.01, coulomb=0.01)))
    found = run(stiff, tmp_path / "a", angle=0.3, goal=0.05)  # in few runs
    assert found.content["reached"]
    assert stiff.farthest < 0.33


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"goal": "0%"}, "goal"),
        ({"command": None}, "command"),
        ({"masses": (-1.0,)}, "mass"),
        ({"arm": 0.0}, "arm"),
        ({"command": 0.0}, "command"),
        ({"known": {"p9": 1.0}}, "p9"),
        ({"known": {"from": "xl33"}}, r"from: got xl33; expected 'xl330' \(did you mean that"),
        ({"known": {"from": "xl330"}}, "got xl330 with input: torque; .* is a voltage, as"),
        ({"angle": 0.0}, "angle"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_moves(tmp_path, options, named):
    motor = Faulty("")
    with pytest.raises(InputError, match=named):
        run(motor, tmp_path / "a", **options)
    assert not motor.commands
