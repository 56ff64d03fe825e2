"""A simulated robot changes while it holds an orbit; the loop notices, names it and retunes."""

import math
from functools import partial

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.experiment.record import RunRecord
from butterfly.experiment.run import perform
from butterfly.experiment.source import Source
from butterfly.files import shipped
from butterfly.model.energy import Orbit
from butterfly.orbit.controller import Dithered, EnergyShaping, gain_for
from butterfly.orbit.loop import swing, watch
from butterfly.orbit.online import OnlineRecalibration, SelfTuning, WatchPlan
from butterfly.plant.rig import Simulator
from butterfly.plant.robot import RobotChange
from butterfly.report.orbit_page import orbit_page, watch_section, watch_sentences
from tests.orbit.setting import NO_ADDED_MASS, SIXTY, plant, sixty_degrees

SPEC = plant({"coulomb": 4e-4}, step=5e-3).model_copy(update={"simulator": Simulator.GREY_BOX})
ORBIT = Orbit.of_amplitude(SPEC.robot.lumped, SIXTY)
AT = 80.0
EMF = {"p4": 1 / 1.05, "p2": 1 - 0.4 * (1 - 1 / 1.05)}  # of R + 5 %, back EMF being 40 % of p2


def target(parameters):
    return Orbit.of_amplitude(parameters, SIXTY)


def law():
    return EnergyShaping(ORBIT, gain_for(ORBIT, 0.5))


def watched(change, duration=110.0, seed=0, **plan):
    rng = np.random.default_rng(seed)
    rig, plan = partial(SPEC.rig.run, rng=rng), WatchPlan(duration=duration, change=change, **plan)
    return watch(rig, plan, SPEC.robot.lumped, 0.0, sixty_degrees(), rng=rng)


@pytest.mark.parametrize(
    ("factors", "named"),
    [
        ({"p1": 1.02}, ["p1"]),
        pytest.param({"coulomb": 1.2}, ["coulomb"], marks=pytest.mark.slow),
        pytest.param({"p2": 1.1}, ["p2"], marks=pytest.mark.slow),  # the shipped experiment's too
        (EMF, []),
    ],
)
def test_a_change_is_noticed_within_two_periods_and_named(factors, named):
    found = watched(RobotChange(at=AT, factors=factors))
    (alarm,) = found.detector.alarms
    assert 0 < alarm.time - AT < 2 * ORBIT.period
    assert alarm.since[0] - 0.25 <= AT <= alarm.since[1] + 0.25
    assert [each.name for each in alarm.possible] == named
    if named:
        (found_alone,) = alarm.possible
        relative = found_alone.after / found_alone.before - 1
        assert relative == pytest.approx(factors[found_alone.name] - 1, rel=0.05)
    else:
        for each in alarm.ratios:
            assert each.after / each.before == pytest.approx(factors.get(each.name, 1.0), abs=0.03)
    (said,) = watch_sentences(found)
    assert ("several parameters, p2/p1 by -" in said) == (not named)
    assert said.endswith(", if only one parameter changed.") == bool(named)
    section = watch_section(found, 0.0)
    assert len(section.tables[0].rows) == 9
    assert section.figures["watched"].data


def test_a_robot_that_stays_as_it_is_raises_no_alarm():
    found = watched(None)
    assert found.detector.alarms == []
    assert watch_sentences(found) == ["Watched for 1.83 min: the robot did not change."]
    assert max(value for _, value in found.detector.history) < found.detector.threshold


def test_after_an_alarm_the_loop_retunes_to_what_the_robot_has_become():
    """And sooner than where the past only fades."""
    change = RobotChange(at=AT, factors={"p2": 2.0, "coulomb": 2.0})
    late = AT + 10.0, AT + 30.0
    plain = law()
    rng = np.random.default_rng(0)
    dithered = Dithered(plain, 0.1, 2 * math.pi / ORBIT.period, rng)
    how = {"multiplier": 0.5, "inertia": ORBIT.parameters.p1, "every": 1.0, "commands": dithered}
    fading = SelfTuning(plain, OnlineRecalibration(memory=60.0), target, **how)
    run = partial(SPEC.rig.run, start=SIXTY, duration=late[1], added=NO_ADDED_MASS, rng=rng)
    logs = [run(fading, change=change), watched(change, late[1], dither=0.1, memory=60.0).log]
    cut = [log.take((log.time >= late[0]) & (log.time <= late[1])) for log in logs]
    slow, quick = (math.degrees(swing(log, 0.0, late[0])) - 60.0 for log in cut)
    assert abs(quick) < 0.7
    assert slow < -3 * abs(quick)


def test_until_it_changes_a_robot_moves_as_if_it_never_did():
    def log(change):
        rng = np.random.default_rng(1)
        return SPEC.rig.run(law(), 0.9, 6.0, NO_ADDED_MASS, rng=rng, change=change)

    before, after = log(None), log(RobotChange(at=3.0, factors={"p3": 1.2}))
    same = before.time <= 3.0
    np.testing.assert_array_equal(after.angle[same], before.angle[same])
    assert np.abs(after.angle - before.angle)[~same].max() > 0.1
    assert RobotChange(at=1.0, factors={"p3": 1.2}).of(SPEC.robot).lumped.p3 == pytest.approx(
        1.2 * SPEC.robot.lumped.p3
    )


@pytest.mark.parametrize(
    ("factors", "field"), [({"p5": 1.1}, "factors"), ({"p2": 0.0}, "p2"), ({"p2": -1.0}, "p2")]
)
def test_a_change_of_nothing_is_refused(factors, field):
    with pytest.raises(InputError, match=field):
        RobotChange(at=1.0, factors=factors)


def test_the_shipped_experiment_watches_its_orbit_and_records_the_alarm():
    """With a first model given, at a coarser clock and sooner."""
    source = Source(shipped("experiments/orbit-change.yaml"))
    content = {**source.content, "excitations": []}
    content["plant"] = content["plant"] | {"clock": {"step": 5e-3}}
    lumped = {"p1": 0.00325, "p2": 0.0011, "p3": 0.049, "p4": 9.9}
    change = {"at": AT, "factors": {"p2": 1.1}}
    watch = content["control"]["watch"] | {"duration": AT + 25.0, "change": change}
    more = {"believed": lumped, "rounds": 1, "duration": 10.0, "watch": watch}
    content["control"] = content["control"] | more
    result = perform(source.experiment(content))
    assert result.error is None
    (alarm,) = result.record.orbit.alarms
    assert [each.name for each in alarm.possible] == ["p2"]
    assert RunRecord.from_json(result.record.to_json()).orbit.alarms == (alarm,)
    page = orbit_page(result.orbit)
    assert ": p2 by +" in page.summary[0]
    assert page.sections[0].title == "Watched for changes"
