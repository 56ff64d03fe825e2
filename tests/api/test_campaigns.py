"""What a campaign says at its end: goal, next step, parameters, runs; the same on all its views."""

import json
from dataclasses import replace

import pytest

import butterfly as bf
from butterfly.cli import output
from butterfly.errors import InputError
from butterfly.model.parameters import NO_ADDED_MASS
from butterfly.model.prior import Prior
from tests.campaigns.ended import BREAKAWAY, FIT, WISH, shares_of, step, told, within_goal
from tests.campaigns.robots import TRUE, Faulty


@pytest.fixture(scope="module")
def reached(result):
    return within_goal(result)


@pytest.fixture(scope="module")
def open_scale(data):
    """Only ratios: identified with p1 = 1, which nobody has given, as campaigns do it."""
    bare = [k for k, log in enumerate(data.logs) if not log.added_mass.mass]
    found = bf.identify(data.take(bare).knowing(Prior.of({"p1": 1.0})), terms=())
    first = step(20.0, shares_of(found.estimate, 0.01))
    more = {"steps": (first,), "reached": False, "ending": "nothing more is known"}
    return told(found, replace(WISH, masses=(NO_ADDED_MASS,)), **more)


def test_the_first_line_says_whether_the_goal_is_reached_and_the_second_what_to_do(reached):
    first, second, verdict, *_ = reached.summary
    assert first == ("The goal of 1 % is reached: 50 s of robot time, 3 runs, 1 change of mass.")
    assert "Next: `butterfly identify 'my folder' --report page.html`" in second
    assert "`butterfly export 'my folder' --out twin.xml`" in second
    assert verdict.startswith("Good: p1 ±")
    assert reached.summary[-1].endswith(f"has a FIT of {FIT} %.")


def test_the_parameters_are_those_of_identify_beside_their_share_of_the_goal(reached, result):
    table, runs = reached.tables()
    theirs = result.tables()[0]
    place = table.headers.index("of the goal")
    own = [(*row[:place], *row[place + 1 :]) for row in table.rows]
    assert own == [tuple(row) for row in theirs.rows]
    shares = {str(row[0]): row[place] for row in table.rows}
    for name, share in shares_of(result.estimate, 0.01).items():
        assert float(shares[name].removesuffix(" %")) == pytest.approx(100 * share, rel=0.06)
    assert shares["delay"] == "–"
    assert [row[-2] for row in runs.rows] == ["ratios only", "good", "held out"]


def test_the_json_has_the_parameters_with_intervals_units_and_the_goal_in_per_cent(reached, result):
    found = json.loads(json.dumps(reached.to_dict()))
    rows = {row["parameter"]: row for row in result.rows()}
    assert found["summary"][0].startswith("The goal of 1 % is reached")
    assert found["parameters"].keys() == rows.keys()
    for name, each in found["parameters"].items():
        assert {key: each[key] for key in rows[name] if key != "parameter"} == {
            key: value for key, value in rows[name].items() if key != "parameter"
        }
    for name, share in shares_of(result.estimate, 0.01).items():
        assert found["parameters"][name]["half_width"] == pytest.approx(share)
        assert found["parameters"][name]["wanted"] == pytest.approx(1.0)
    assert found["units"]["parameters.wanted"] == "%"


def test_without_a_scale_the_parameters_are_ratios_to_p1(open_scale, data):
    first, second, verdict, *_ = open_scale.summary
    assert "not reached" in first
    assert "only ratios to p1 are known" in second
    assert "`--known p4=VALUE`" in second
    assert verdict.startswith("Good: p4/p1 ±")
    table, runs = open_scale.tables()
    assert table.title == "Parameters, ratios to p1"
    assert [str(row[0]) for row in table.rows][:4] == ["p2/p1", "p3/p1", "p4/p1", "coulomb/p1"]
    assert "N m/(kg m²)" in table.rows[1]
    assert open_scale.content["ratios"]
    true = bf.read_experiment("quickstart").plant.robot.lumped
    value = open_scale.content["parameters"]["p3"]["value"]
    assert value == pytest.approx(true.p3 / true.p1, rel=0.01)
    assert [row[-2] for row in runs.rows] == ["ratios only"]
    assert data.logs[0].input_kind == "voltage"
    assert "ratios to p1" in open_scale.page().sections[0].text
    assert open_scale.facts()[-1][1:] == ("0.04 V", "command")


def test_it_says_at_what_torque_the_joint_breaks_away(reached, result):
    torque = BREAKAWAY * result.estimate.named["p4"]
    fact = reached.facts()[-1]
    assert fact.value == f"{torque:.2g} N m"
    assert fact.detail == "a command of 0.04 V"


def test_a_saved_campaign_shows_what_it_showed(reached, open_scale, tmp_path):
    for found in (reached, open_scale):
        found.save(tmp_path / "saved.json")
        again = bf.load(tmp_path / "saved.json")
        assert again.to_dict() == found.to_dict()
        assert (str(again), again.tables(), again.facts()) == (
            str(found),
            found.tables(),
            found.facts(),
        )
        assert again.page().headed == found.page().headed
        assert [*again.figures()] == ["shrinking", "played"]


def test_a_command_prints_the_goal_above_the_verdict_and_keeps_both_if_quiet(
    reached, capsys, monkeypatch
):
    output.show(reached)
    printed = capsys.readouterr().out.splitlines()
    assert printed[:4] == list(reached.summary[:4])
    monkeypatch.setattr(output, "asked", output.OutputOptions(quiet=True))
    output.show(reached)
    assert capsys.readouterr().out.splitlines() == list(reached.summary[:4])


ARM = """<mujoco><worldbody><body><joint name="lift" axis="0 1 0" range="-60 60" armature="0.003"
  actuatorfrcrange="-0.04 0.04"/><inertial pos="0 0 -0.1" mass="0.04" diaginertia="1e-5 1e-5 1e-5"/>
  <body pos="0 0 -0.1"><joint name="grip" axis="1 0 0"/><joint name="rail" type="slide"/>
  <inertial pos="0 0 0" mass="0.011" diaginertia="1e-5 1e-5 1e-5"/></body></body></worldbody>
</mujoco>"""
"""A joint with the gravity moment of `tests.campaigns.robots.TRUE`."""

LIFT = {"of": "lift", "clamped": True, "known": {"p4": TRUE.p4}}


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "arm.xml"
    path.write_text(ARM)
    return path


def _on_arm(arm, out, motor, **options):
    return bf.campaign(motor, out=out, step=0.002, command=0.2, **(LIFT | {"model": arm}) | options)


@pytest.fixture(scope="module")
def on_arm(arm, tmp_path_factory):
    """The motor of a joint of a model, and its campaign."""
    out, motor = tmp_path_factory.mktemp("campaign") / "lift", Faulty("")
    return out, motor, _on_arm(arm, out, motor)


def test_a_campaign_on_a_joint_of_a_model_needs_no_mass_and_keeps_what_the_file_allows(on_arm):
    out, motor, answer = on_arm
    assert answer.content["reached"]
    assert answer.content["changes"] == 0
    assert max(map(abs, motor.commands)) <= 0.04 / TRUE.p4
    (said,) = [text for text in answer.summary if text.startswith("By lift of arm.xml")]
    assert "at most 0.838 rad from rest" in said
    assert "commands up to 0.133" in said
    manifest = bf.read(out).manifest
    assert (manifest.of, manifest.clamped, manifest.facts.file) == ("lift", True, "arm.xml")


def test_identify_says_of_its_folder_what_the_file_lacks(on_arm):
    rows = {row["attribute"]: row for row in bf.identify(on_arm[0]).to_dict()["model"]}
    links = 0.051 * 0.1**2 + 2e-5
    assert rows["armature"]["lower"] <= TRUE.p1 - links <= rows["armature"]["upper"]
    assert rows["armature"]["in_file"] == 0.003


def test_a_campaign_of_one_joint_does_not_go_on_with_another(on_arm):
    with pytest.raises(InputError, match="lift, in the pose and model") as refused:
        bf.campaign(Faulty(""), out=on_arm[0], command=0.2, known={"p4": TRUE.p4})
    assert refused.value.field == "of"


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"clamped": False}, "clamped"),
        ({"of": None}, "model"),
        ({"model": None}, "of"),
        ({"of": "lid"}, "joint"),
        ({"of": "rail"}, "joint"),
        ({"pose": {"lid": 1.0}}, "pose.lid"),
    ],
)
def test_what_a_campaign_cannot_do_with_a_model_is_refused(arm, tmp_path, options, field):
    motor = Faulty("")
    with pytest.raises(InputError) as refused:
        _on_arm(arm, tmp_path / "a", motor, **options)
    assert refused.value.field == field
    assert not motor.commands


def test_a_joint_that_hangs_outside_of_its_range_is_refused(tmp_path):
    turned = tmp_path / "turned.xml"
    turned.write_text(ARM.replace('range="-60 60"', 'range="90 200"'))
    with pytest.raises(InputError, match=r"outside of 1\.57 to 3\.49"):
        _on_arm(turned, tmp_path / "a", Faulty(""))
