"""The arrays that derivatives are carried with.

Derivatives are carried over many steps at a time, from a tape of what happened. The arrays are few
and large, since numba counts references to each that a function takes, which for every step would
cost more than the step.

tape (n, 48)
    A row for each step, reversal, rest and breaking loose: `KIND`, the fraction `BEGIN` of its part
    of the interval at which it begins, the `SHARE` of the part that it takes, the `SIGN` of the
    sliding, then the number of the interval, of its part, and how many parts there are. From
    `STAGE` on: at each of the four stages of a step, x v m z v' m' z' and sin x, cos x and the
    excess of Stribeck friction, which cost more than all the rest; for a rest, x and the motor's
    torque; for breaking loose, x, with a lag the net torque at the rest's beginning and at the
    interval's end, and the fraction at which it does.
    The first row counts those that follow (`COUNT`) and says where in time the simulation is, and
    which interval the derivatives are in (`CURRENT`).
tangents (6, k)
    Derivatives, by the k columns, of the four states; of the instant from which the state is left,
    as a share of the part (`LATE`); and of the motor's torque before a rest (`BEFORE`).
column (k,)
    The number in `COLUMNS` by which each column differentiates; -1 for the initial state alone.
stages (4, 4, _)
    At each of the four stages, for the rate of each state: its derivatives by the states, from
    `BASIS` on those by every constant and drive, from `WEIGHT` on the weights of all rates of the
    stage in the state at the step's end, and at `RATE` itself.
moved (q, n - 1, 3)
    The inputs, by which p4 is felt, and their derivatives by delay and compression, as many as are
    needed; ``own`` (3, 3) are those of one part of an interval.
"""

from __future__ import annotations

from butterfly.model.kernel.constants import DRIVES, MOST_DRIVES

STEP, REVERSAL, REST, LOOSE = 0.0, 1.0, 2.0, 3.0
KIND, BEGIN, SHARE, SIGN, INTERVAL, PART, PARTS = range(7)
COUNT, CURRENT = 0, 7
STAGE, PER_STAGE = 8, 10
TAPE_WIDTH = STAGE + 4 * PER_STAGE
LATE, BEFORE = 4, 5
BASIS = 4
WEIGHT = BASIS + DRIVES + MOST_DRIVES
RATE = WEIGHT + 4
