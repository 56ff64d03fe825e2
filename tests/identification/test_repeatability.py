"""Two runs of one mass that contradict each other are named; sound ones never are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import butterfly as bf
from butterfly.identification import repeatability
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import OutputError
from butterfly.identification.repeatability import (
    Repeatability,
    contradicting_runs,
    contradiction_text,
    ratios_of,
)
from butterfly.identification.trust import FindingKind
from butterfly.logs.log import Sine
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from butterfly.verdict import Level
from tests.identification.simulated import driven
from tests.independent.integrator import Joint

_CASE = Path(__file__).parents[3] / "shared/data/cases/fifth/mass-not-changed"
JOINT = Joint(inertia=0.003, viscous=1.5e-3, gravity=0.06, gain=1.0, coulomb=1.5e-3, delay=0.004)
HEAVY = AddedMass(mass=0.05, arm=0.1)
TIME = np.arange(0, 10, 4e-3)
PLAYED = ("little", "wide", "square", "noise")
"""Inputs of different swings: about 0.1 rad, the others about 0.6 rad."""


def _played(name):
    rng = np.random.default_rng(3)
    if name == "square":
        return 0.02 * np.sign(np.sin(4.1 * TIME)) * (TIME > 0.5)
    if name == "noise":
        return 0.02 * np.repeat(rng.choice([-1.0, 1.0], TIME.size // 50), 50)
    lines = sum(np.sin(omega * TIME + omega**2) for omega in (1.3, 2.9, 4.3, 6.1, 8.3))
    return {"little": 0.003, "wide": 0.012}[name] * lines


def _run(name, joint=JOINT, *, mounted=NO_ADDED_MASS, said=None, counts=4096, noise=0.0, seed=0):
    """Record a run of a joint with a mass mounted, whatever is said of it."""
    loaded = joint._replace(
        inertia=joint.inertia + mounted.inertia, gravity=joint.gravity + mounted.gravity_moment
    )
    log = driven(loaded, TIME, _played(name), added_mass=mounted if said is None else said)
    count = 2 * np.pi / counts
    read = log.angle + noise * np.random.default_rng(seed).standard_normal(TIME.size)
    return replace(log, angle=np.round(read / count) * count)


def _named(*runs):
    return [replace(run, source=f"run_{k}") for k, run in enumerate(runs)]


def test_identify_names_two_runs_of_one_mass_where_it_stayed_on_in_most():
    runs = _named(
        _run("wide", counts=65536),
        *(_run(name, mounted=HEAVY, said=NO_ADDED_MASS, counts=65536) for name in PLAYED[1:]),
        *(_run(name, mounted=HEAVY, counts=65536) for name in PLAYED[1:]),
    )
    found = bf.identify(runs, OutputError(terms=(), workers=1))
    (finding,) = [e for e in found.estimate.findings if e.kind is FindingKind.UNREPEATED]
    names = [name.split(", ")[-1] for name in finding.logs]
    assert names == ["run_0", "run_1", "run_1", "run_4"]
    assert finding.number == pytest.approx(0.003 / (0.003 + HEAVY.inertia) - 1, abs=0.01)
    assert found.estimate.level is Level.WARNING
    first, second, odd, like = finding.logs
    assert f"{first} and {second} are declared with the same mass" in found.summary[0]
    assert f"{odd} moves like {like}" in found.summary[0]


def test_the_mass_that_stayed_on_in_a_campaign_is_named():
    if not _CASE.is_dir():
        pytest.skip(f"the case is not there: {_CASE}")
    found = contradicting_runs(bf.read(_CASE))
    assert (found.earlier.name, found.later.name) == ("run_000.parquet", "run_001.parquet")
    assert (found.odd.name, found.like.name) == ("run_001.parquet", "run_002.parquet")
    assert found.gains == pytest.approx(
        (0.018 / 0.0021, 0.018 / (0.0021 + 0.04 * 0.08**2)), rel=0.01
    )
    assert found.stiffness[0] == pytest.approx(0.085 / 0.0021, rel=0.01)
    assert "run_000.parquet and run_001.parquet" in contradiction_text(found.finding)


# a mass of the joint's own inertia is easily found: with one input here, slowly with all
@pytest.mark.parametrize(
    ("second", "share"),
    [
        *((name, 0.06) for name in PLAYED),
        ("little", 1.0),
        *(pytest.param(name, 1.0, marks=pytest.mark.slow) for name in PLAYED[1:]),
    ],
)
def test_a_mass_of_a_share_of_the_inertia_is_found_whatever_is_played(second, share):
    mounted = AddedMass(mass=share * JOINT.inertia / 0.1**2, arm=0.1)
    runs = _named(
        _run("wide", counts=1024), _run(second, mounted=mounted, said=NO_ADDED_MASS, counts=8192)
    )
    assert contradicting_runs(DataSet.of(runs)) is not None


UNMODELLED = {
    "nothing": {},
    "drag": {"drag": 1e-3},
    "bias": {"bias": 2e-3},
    "excess friction": {"excess": 1.5e-3, "excess_velocity": 0.15},
    "gravity beside": {"gravity_beside": 3e-3},
    "wear": {"wear": 0.02},
    "dry": {"coulomb": 4e-3},
    "base": {"base": 2.0, "base_viscous": 5.0, "base_spring": 800.0, "imbalance": 0.006},
}


@pytest.mark.parametrize("more", UNMODELLED)
def test_runs_of_one_mass_are_not_accused_whatever_the_model_lacks(more):
    joint = JOINT._replace(**UNMODELLED[more])
    runs = [
        _run(name, joint, counts=counts, noise=2e-4, seed=number)
        for number, (name, counts) in enumerate(zip(PLAYED, [65536, 1024] * 2, strict=True))
    ]
    assert contradicting_runs(DataSet.of(_named(*runs))) is None


def test_friction_that_differs_from_run_to_run_is_no_other_mass():
    warm = JOINT._replace(coulomb=0.6 * JOINT.coulomb, viscous=0.7 * JOINT.viscous)
    for name in PLAYED:
        runs = _named(_run("wide", counts=65536), _run(name, warm, counts=65536))
        assert contradicting_runs(DataSet.of(runs)) is None, name


def test_runs_with_different_masses_are_not_compared():
    light = AddedMass(mass=0.02, arm=0.1)
    runs = _named(_run("wide"), _run("wide", mounted=light), _run("square", mounted=HEAVY))
    assert contradicting_runs(DataSet.of(runs)) is None


def test_a_run_that_says_too_little_accuses_nobody():
    still = replace(_run("little", mounted=HEAVY), input=np.zeros(TIME.size))
    short = _run("square", mounted=HEAVY).take(slice(0, 40))
    sine = replace(_run("wide", mounted=HEAVY), excitation=Sine(omega=4.0, amplitude=0.01))
    for poor in (still, short, sine):
        assert ratios_of(poor) is None


def test_the_ratios_of_each_run_of_a_campaign_are_computed_once(monkeypatch):
    computed = []
    monkeypatch.setattr(
        repeatability, "ratios_of", lambda log: computed.append(log.name) or ratios_of(log)
    )
    data = DataSet.of(_named(*(_run(name) for name in PLAYED)))
    compared = Repeatability()
    for number in range(len(data.logs)):
        so_far = data.take(range(number + 1))
        assert compared.contradiction(so_far, number) is None
    assert sorted(computed) == [log.name for log in data.logs]
