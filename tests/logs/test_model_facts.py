"""What a data set carries of somebody's robot model: its poses, and what all of them have."""

import pytest
from pydantic import ValidationError

from butterfly.logs.model_facts import LinkMasses, ModelFacts, PoseFacts
from butterfly.model.parameters import JointKind

GRAVITY = 9.81


def _pose(inertia, moment):
    return PoseFacts(inertia=inertia, moment=moment, zero=0.1)


def _facts(*poses, **told):
    about = {
        "file": "arm.xml",
        "joint": "elbow",
        "kind": JointKind.HINGE,
        "gravity": GRAVITY,
        "armature": 0.02,
        "damping": 0.1,
        "frictionloss": 0.2,
    }
    return ModelFacts(poses=[*poses], **(about | told))


def test_of_one_pose_the_bare_joint_is_the_joint():
    facts = _facts(_pose(0.05, 1.5))
    assert facts.bare == (0.05, 1.5)
    assert facts.largest == 1.5
    assert facts.gravity_tells_scale


def test_every_pose_adds_a_mass_at_an_arm_of_two_centimetres_at_least():
    poses = [_pose(0.0300, 1.2), _pose(0.0302, 1.4), _pose(0.09, 2.0)]
    facts = _facts(*poses)
    inertia, moment = facts.bare
    assert moment == 1.2
    assert inertia == pytest.approx(0.0302 - 0.02 * 0.2 / GRAVITY)
    for pose in poses:
        first = (pose.moment - moment) / GRAVITY  # mass times arm
        assert pose.inertia - inertia >= 0.02 * first - 1e-12


def test_about_a_vertical_axis_the_least_inertia_is_bare():
    facts = _facts(_pose(0.05, 0.0), _pose(0.03, 0.0), gravity=0.0)
    assert facts.bare == (0.03, 0.0)
    assert not facts.gravity_tells_scale


def test_gravity_tells_the_scale_where_a_fifth_of_it_is_in_every_pose():
    assert _facts(_pose(0.05, 0.5), _pose(0.06, 2.0)).gravity_tells_scale
    assert not _facts(_pose(0.05, 0.3), _pose(0.06, 2.0)).gravity_tells_scale


def test_gravity_tells_no_scale_where_each_link_is_off_by_itself():
    facts = _facts(_pose(0.05, 1.5), links=LinkMasses(independent=True))
    assert not facts.gravity_tells_scale


def test_facts_are_the_same_after_they_were_written():
    facts = _facts(_pose(0.05, 1.5), _pose(0.06, 1.7), range=(-1.0, 2.0), links=LinkMasses())
    assert ModelFacts.model_validate(facts.model_dump(mode="json")) == facts


@pytest.mark.parametrize(
    "told", [{"uncertainty": -0.1}, {"uncertainty": "five"}, {"independently": True}]
)
def test_uncertainties_of_masses_are_checked(told):
    with pytest.raises(ValidationError):
        LinkMasses(**told)
