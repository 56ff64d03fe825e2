"""The compiled kernel: the grey-box equation, its events in time, and the derivatives of both.

`butterfly.model.greybox` says what it means, `butterfly.model.greybox` what is
differentiated.

- `constants`: what the equation needs to know, the numbers of the columns, and what happened at
  each step, kept for the derivatives
- `equation`: the rates of the state, and what drives the joint during one interval
- `steps`: Runge-Kutta steps, split where the velocity vanishes
- `linearise`: the derivatives of the rates
- `events`: the derivatives where a joint reverses, rests and breaks loose
- `differentiate`: the derivatives over one step, and over a whole simulation
"""

from butterfly.model.kernel.constants import COLUMNS, Constants, State
from butterfly.model.kernel.differentiate import differentiate
from butterfly.model.kernel.equation import least_steps, rates
from butterfly.model.kernel.steps import integrate, interval

__all__ = [
    "COLUMNS",
    "Constants",
    "State",
    "differentiate",
    "integrate",
    "interval",
    "least_steps",
    "rates",
]
