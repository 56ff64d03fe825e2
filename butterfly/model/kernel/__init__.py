"""The compiled kernel: the grey-box equation, its events in time, and the derivatives of both.

`butterfly.model.greybox` says what it means, `butterfly.model.greybox` what is
differentiated.

- `equation`: what it needs to know, the rates of the state, and their derivatives
- `steps`: Runge-Kutta steps, split where the velocity vanishes, what drives them, and the tape of
  what happened
- `events`: the derivatives where a joint reverses, rests and breaks loose
- `differentiate`: the derivatives over one step, and over a whole simulation
"""

from butterfly.model.kernel.differentiate import differentiate
from butterfly.model.kernel.equation import COLUMNS, Constants, State, least_steps, rates
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
