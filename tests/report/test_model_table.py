"""The table of a model's attributes, of an estimate that is written down."""

import numpy as np
import pytest

from butterfly.identification.estimate import Estimate
from butterfly.identification.identified import Identified
from butterfly.logs.model_facts import LinkMasses, ModelFacts, PoseFacts
from butterfly.report.parameter_table import model_sentences, model_table

VALUES = {"p1": 0.05, "p2": 0.1, "p3": 1.5, "coulomb": 0.02}
ERRORS = {"p1": 0.0005, "p2": 0.01, "p3": 0.0, "coulomb": 0.001}


def _facts(**changed):
    about = {"file": "arm.xml", "joint": "elbow", "kind": "hinge", "gravity": 9.81}
    about |= {"armature": 0.01, "damping": 0.3, "frictionloss": 0.0, "others": ["wrist"]}
    pose = PoseFacts(pose={"wrist": 0.25}, inertia=0.04, moment=1.5, zero=0.0)
    return ModelFacts(**(about | {"poses": [pose]} | changed))


def _identified(facts):
    values, errors = np.array([*VALUES.values()]), np.array([*ERRORS.values()])
    estimate = Estimate(
        method="by hand",
        names=tuple(VALUES),
        values=values,
        covariance=np.diag(errors**2),
        lower=values - 1.959964 * errors,
        upper=values + 1.959964 * errors,
        fixed={"p4": 1.0},
    )
    manifest = facts and {"facts": facts.model_dump(mode="json")}
    origin = {"name": "logs", "input": "torque", "manifest": manifest}
    return Identified(estimate=estimate, estimator="by hand", origin=origin, fits={"log": 99.0})


def test_each_attribute_stands_beside_what_the_file_says():
    table = model_table(_identified(_facts()))
    assert table.title == "Joint 'elbow' of arm.xml"
    assert [*map(tuple, table.rows)] == [
        ("armature", "0.01000 ± 0.00098", "0.01", "kg m²", "the file agrees"),
        ("damping", "0.100 ± 0.020", "0.3", "N m s/rad", "the file differs"),
        ("frictionloss", "0.0200 ± 0.0020", "0", "N m", "not in the file"),
    ]


def test_masses_that_are_off_each_by_itself_widen_the_armature_alone():
    rows = model_table(
        _identified(_facts(links=LinkMasses(uncertainty=0.05, independent=True)))
    ).rows
    half = 1.959964 * np.hypot(0.0005, 0.05 * 0.04)
    assert rows[0][1] == f"0.0100 ± {half:.4f}"
    assert rows[1][1] == "0.100 ± 0.020"


@pytest.mark.parametrize(
    ("links", "said"),
    [
        (LinkMasses(), "± 5 %, with one common factor."),
        (LinkMasses(uncertainty=0.1, independent=True), "± 10 %, each independently."),
    ],
)
def test_it_is_said_how_well_the_links_are_known_and_where_the_others_are(links, said):
    first, second = model_sentences(_identified(_facts(links=links)))
    assert first == f"Masses of the links are taken from arm.xml, {said}"
    assert second == "Pose of the other joints: wrist 0.25."


def test_without_a_model_there_is_nothing_to_show():
    assert not model_table(_identified(None)).rows
    assert not [*model_sentences(_identified(None))]
