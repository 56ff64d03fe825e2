"""Numbers that no bench has are refused by name, and those that one may have are not."""

import numpy as np
import pytest

from butterfly.errors import InputError
from butterfly.logs.health import examine
from butterfly.logs.log import Log

TIME = np.arange(40) * 0.01
RAMP = np.arange(40.0)


@pytest.mark.parametrize(
    ("time", "inputs", "angle", "message"),
    [
        (TIME, RAMP, 1e31 * RAMP, "angle: got numbers up to 3.9e"),
        (TIME, RAMP, -1e31 * RAMP, "angle: got numbers up to 3.9e"),
        (TIME, 1e-32 * RAMP, RAMP, "input: got numbers that differ by 3.9e-31"),
        (1e-40 * RAMP, RAMP, RAMP, "time: got numbers that differ by 3.9e-39"),
        (np.append(1e-31 * RAMP[:20], TIME[20:]), RAMP, RAMP, "time: got stamps 1e-31 s apart"),
    ],
)
def test_what_no_bench_has_is_refused(time, inputs, angle, message):
    with pytest.raises(InputError, match=message):
        examine(Log(time, inputs, angle))


def test_what_a_bench_may_have_is_not():
    examine(Log(1e-6 * RAMP, 0.0 * RAMP, 1e12 + RAMP))
    examine(Log(1.7e9 + TIME, 1e-9 * RAMP, 1e-9 * RAMP, velocity=1e300 * RAMP))
