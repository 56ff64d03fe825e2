"""What happens in a simulation is kept on a tape (see `butterfly.model.kernel.layout`)."""

from __future__ import annotations

import math

from butterfly.compiled import compiled
from butterfly.model.kernel.constants import V, X
from butterfly.model.kernel.equation import excess_at
from butterfly.model.kernel.layout import (
    BEGIN,
    COUNT,
    INTERVAL,
    KIND,
    PART,
    PARTS,
    PER_STAGE,
    SHARE,
    SIGN,
    STAGE,
)


@compiled
def record(state, rate, stage, c, tape):
    """Write one stage of a step on the tape's next row, which another trial may write again."""
    row, at = int(tape[0, COUNT]) + 1, STAGE + PER_STAGE * stage
    for i in range(4):
        tape[row, at + i] = state[i]
    for i in range(3):
        tape[row, at + 4 + i] = rate[i]
    tape[row, at + 7], tape[row, at + 8] = math.sin(state[X]), math.cos(state[X])
    tape[row, at + 9] = excess_at(state[V], c)


@compiled
def note(kind, begin, share, sign, tape):
    """Keep the tape's next row: it becomes what happened."""
    row = int(tape[0, COUNT]) + 1
    tape[row, KIND], tape[row, BEGIN] = kind, begin
    tape[row, SHARE], tape[row, SIGN] = share, sign
    for i in (INTERVAL, PART, PARTS):
        tape[row, i] = tape[0, i]
    tape[0, COUNT] = row
