"""A motor on the bench: what is played, and how it comes to rest."""

from dataclasses import replace

import numpy as np
import pytest

from butterfly.campaigns.bench import Bench
from butterfly.campaigns.drive import SafetyStop
from butterfly.campaigns.guard import Limits
from tests.campaigns.robots import COMMAND, TRUE, Faulty, rig


@pytest.mark.parametrize(("command", "brake"), [(0.03, COMMAND), (COMMAND, 0.02)])
def test_a_limit_cuts_a_run_short_and_the_drive_is_off_where_the_brake_is_too_weak(command, brake):
    motor = Faulty("", of=rig(true=replace(TRUE, p2=1e-4, coulomb=0.0)))
    with Bench(motor, Limits(command=COMMAND, angle=0.2), 0.002) as bench:
        bench.settle()
        bench.braked_with(brake, 0.5)
        cut = bench.run(lambda _: command, 5.0)
        if brake >= command:
            bench.settle()
        else:
            with pytest.raises(SafetyStop, match="beyond its limit"):
                bench.settle()
    assert "swing" in cut.cut
    assert np.abs(cut.angle).max() < 0.22
    assert motor.farthest < 0.25
