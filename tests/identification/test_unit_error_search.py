"""Which mistake explains logs that no joint follows, and that right ones are accused of none."""

import re
from dataclasses import replace

import numpy as np
import pytest

import butterfly as bf
from butterfly.errors import ButterflyError, IdentifiabilityError, InputError
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import HarmonicBalance, OutputError, WeakForm
from butterfly.identification.identify import identify
from butterfly.identification.unit_errors import (
    UnitError,
)
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import Prior
from butterfly.verdict import Level
from tests.conftest import MASSES
from tests.identification.mistaken import named_of, recorded, with_names
from tests.identification.simulated import ROBOT, SWINGS, simulated, steady, wild
from tests.independent.defects import draw as draw_bench
from tests.independent.integrator import Joint, motion
from tests.independent.slips import NAMED, ask

FEW = {omega: SWINGS[omega] for omega in (2.0, 4.4, 8.5)}
BALANCE = HarmonicBalance(terms=())
SIMULATED = OutputError(terms=(), workers=1)


@pytest.fixture(scope="module")
def logs():
    """Logs of sines with names of their own."""
    return with_names(steady(ROBOT, FEW))


@pytest.fixture(scope="module")
def sines(logs):
    """The same, with noise."""
    return recorded(logs)


@pytest.fixture(scope="module")
def tones():
    """Logs of other inputs."""
    return recorded(wild(ROBOT, MASSES * 2, 8.0))


def test_one_log_is_accused_only_if_the_others_fit_to_noise_without_it(tones):
    """A dead zone of the drive that the fit lacks looked like another mass of one log."""
    late = [
        replace(each, input=np.interp(each.time - 0.05, each.time, each.input)) for each in tones
    ]
    (slip,), *_ = named_of([*tones[:1], late[1], *tones[2:]], WeakForm())
    assert (slip.parameters[0], slip.logs) == (UnitError.LATE, ("run 1",))
    found = identify(DataSet.of(draw_bench("dead zone", 3, seed=77).logs), WeakForm()).estimate
    assert [each.logs for each in found.findings if each.kind in NAMED] == []


@pytest.mark.parametrize("gain", [1.0, (1.0, 0.05)], ids=["exact", "uncertain"])
def test_a_wrong_sign_beside_a_known_gain_is_named_in_the_unit_of_the_file(tmp_path, gain):
    joint = Joint(inertia=0.2, viscous=0.2, gravity=0.5, gain=1.0, coulomb=0.1, delay=4e-3)
    time = 4e-3 * np.arange(3000)
    for k in range(3):
        torque = 0.4 * sum(np.sin(w * (1 + 0.2 * k) * time + k) for w in (1.3, 2.9, 5.1))
        angle, _ = motion(joint, time, torque)
        table = np.column_stack([time, -1e3 * torque, angle])
        path = tmp_path / f"{k}.csv"
        np.savetxt(path, table, delimiter=",", header="time,input [mNm],angle", comments="")
    told = {"input": "torque", "known": {"p4": gain}}
    with pytest.raises(IdentifiabilityError, match="opposite directions") as said:
        identify(bf.read(tmp_path, **told), SIMULATED)
    advised = re.search("--units input=(-mNm),", str(said.value))[1]
    found = identify(bf.read(tmp_path, **told, units={"input": advised}), SIMULATED)
    assert found.estimate.parameters.p1 == pytest.approx(0.2, rel=0.05)


def test_a_slip_is_said_first_and_its_factor_with_it(tones):
    degrees = [replace(log, angle=np.degrees(log.angle)) for log in tones]
    (slip, *_), level, said = named_of(degrees, WeakForm(terms=()))
    assert slip.number == pytest.approx(np.pi / 180)
    assert level is Level.WARNING
    assert said.startswith(
        "Do not use: The angle looks like degrees: multiplied by pi/180 (0.01745),"
    )


@pytest.mark.parametrize(
    "factor", [0.1, *(pytest.param(each, marks=pytest.mark.slow) for each in (0.8, 1.3, 5.0))]
)
def test_of_three_masses_that_disagree_the_right_value_is_among_those_given(sines, factor):
    """Any one of three may be wrong: only their ratios are seen; the bare hand never is."""
    _, right, other = sorted({log.added_mass for log in sines})
    wrong = replace(right, mass=factor * right.mass)
    logs = [replace(log, added_mass=wrong) if log.added_mass == right else log for log in sines]
    slips, _, said = named_of(logs, BALANCE)
    fitting = {each.parameters[1]: each.number for each in slips}
    assert fitting[str(wrong)] == pytest.approx(right.mass, rel=0.05)
    assert fitting[str(other)] == pytest.approx(other.mass * factor, rel=0.05)
    assert all(each.parameters[1] != str(AddedMass()) for each in slips)
    assert said.index("contradict each other") < said.index("explanations")


def test_of_four_masses_the_wrong_one_is_found_alone():
    heavy, wrong = replace(MASSES[2], mass=0.2), replace(MASSES[1], mass=0.08)
    logs = steady(ROBOT, FEW, masses=(*MASSES, heavy))
    told = [replace(log, added_mass=wrong) if log.added_mass == MASSES[1] else log for log in logs]
    (slip,), *_ = named_of(told, BALANCE)
    assert slip.parameters[1:] == (str(wrong), "1")
    assert slip.number == pytest.approx(MASSES[1].mass, rel=0.05)


def test_a_log_that_spoils_the_whole_estimate_is_found_by_leaving_it_out(sines):
    """Next to its resonance, and said to carry nothing: the balance ends with hardly any p4."""
    logs = list(sines)
    logs[7] = replace(logs[7], added_mass=AddedMass())
    slips, *_ = named_of(logs, BALANCE)
    (slip,) = [each for each in slips if each.kind == "unit-error"]
    assert slip.logs == ("run 7",)
    assert slip.number == pytest.approx(MASSES[2].mass, rel=0.05)


@pytest.mark.parametrize("ratio", [0.97, 1.01, 1.5])
def test_a_wrong_omega_is_named_with_its_log_and_the_right_one(sines, ratio):
    told = replace(sines[4].excitation, omega=sines[4].excitation.omega * ratio)
    logs = [*sines[:4], replace(sines[4], excitation=told), *sines[5:]]
    answer = ask(logs, "A")
    assert answer.recognised
    right = re.search(
        r"for run 4: (?:times|multiplied by) ([\d.]+),? .*? \(([\d.]+) rad/s\)", answer.text
    )
    assert float(right[1]) == pytest.approx(1 / ratio, rel=2e-3)
    assert float(right[2]) == pytest.approx(sines[4].excitation.omega, rel=2e-3)


def _let_go(mass):
    return simulated(ROBOT, mass, np.zeros_like, 12.0, start=0.8)


def test_columns_swapped_in_free_decays_are_named_but_a_blocked_joint_is_no_such(sine_log):
    logs = [replace(log, input=log.angle, angle=log.input) for log in map(_let_go, MASSES)]
    with pytest.raises(InputError, match="Input and angle look swapped"):
        DataSet.of(logs)
    blocked = replace(sine_log, angle=np.zeros_like(sine_log.angle), excitation=None)
    with pytest.raises(InputError) as refused:
        DataSet.of([blocked])
    assert "swapped" not in str(refused.value)


def test_a_lone_log_that_no_model_follows_is_judged_though_no_other_can_tell_its_mass():
    lone = simulated(ROBOT, MASSES[1], lambda t: 0.02 * np.sin(3 * t), 12.0)
    found = identify(DataSet.of([lone], known=Prior.of({"p4": -ROBOT.p4})), WeakForm(terms=()))
    assert found.estimate.level is Level.WARNING


@pytest.mark.parametrize("estimator", [WeakForm(), OutputError(workers=1)])
def test_logs_that_were_never_driven_are_refused(estimator):
    decays = [_let_go(mass) for mass in MASSES]
    with pytest.raises(IdentifiabilityError, match="the input is always zero"):
        identify(DataSet.of(decays), estimator)


def test_refusals_of_sines_name_a_unit_where_one_explains_them(sines, sine_log):
    turns = [replace(each.excitation, omega=each.excitation.omega / (2 * np.pi)) for each in sines]
    in_hz = [replace(log, excitation=sine) for log, sine in zip(sines, turns, strict=True)]
    with pytest.raises(InputError, match=r"look like Hz: multiplied by 2 pi"):
        DataSet.of(in_hz)
    with pytest.raises(InputError, match="mean sampling interval"):
        DataSet.of([sine_log.take(np.arange(0, sine_log.time.size, 400))])
    with pytest.raises(ButterflyError) as refused:
        identify(DataSet.of([log for log in sines if log.added_mass.mass == 0]))
    assert "look" not in str(refused.value)
