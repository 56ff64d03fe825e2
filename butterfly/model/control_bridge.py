"""The model as python-control's objects, for those who go on in their own tools."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import control
import numpy as np

from butterfly.model.energy import pull, stiffness
from butterfly.model.harmonic import coulomb_describing_function, gravity_describing_function

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from butterfly.model.parameters import LumpedParameters


def state_space(parameters: LumpedParameters, angle: float = 0.0) -> control.StateSpace:
    """Linearise about rest at ``angle`` rad: states angle and velocity, input the command.

    Coulomb friction and delay are left out; see `transfer_function` for the delay.
    """
    p = parameters
    return control.ss(
        [[0.0, 1.0], [-stiffness(p, angle) / p.p1, -p.p2 / p.p1]],
        [[0.0], [p.p4 / p.p1]],
        np.eye(2),
        np.zeros((2, 1)),
        inputs=["command"],
        outputs=["angle", "velocity"],
        states=["angle", "velocity"],
    )


def transfer_function(
    parameters: LumpedParameters, *, pade_order: int = 0
) -> control.TransferFunction:
    """G(s) from command to angle about the hanging position (13).

    Parameters
    ----------
    parameters
        Of the hand with what it carries.
    pade_order
        Of the approximation of the delay; 0 leaves it out.
    """
    p = parameters
    plant = control.tf([p.p4], [p.p1, p.p2, p.p3])
    if pade_order == 0 or p.delay == 0:
        return plant
    return plant * control.tf(*control.pade(p.delay, pade_order))


def frequency_response_data(omega: ArrayLike, response: ArrayLike) -> control.FrequencyResponseData:
    """Wrap measured responses, in rad per unit of input, at frequencies in rad/s."""
    order = np.argsort(np.asarray(omega))
    return control.frd(np.asarray(response)[order], np.asarray(omega)[order])


class GravityNonlinearity(control.DescribingFunctionNonlinearity):  # type: ignore[misc]
    """sin th with its describing function 2 J1(a)/a."""

    def __call__(self, angle: float) -> float:
        """Return sin of an angle in rad."""
        return math.sin(angle)

    def _isstatic(self) -> bool:
        return True

    def describing_function(self, amplitude: float) -> complex:
        """Return the gain at an amplitude in rad."""
        return complex(gravity_describing_function(amplitude))


def friction_gain(parameters: LumpedParameters, amplitude: ArrayLike) -> NDArray[np.complex128]:
    """Torque over angle of Coulomb friction at swings in rad, by its describing function."""
    return np.asarray(parameters.coulomb * coulomb_describing_function(amplitude))


def nonlinear_system(
    parameters: LumpedParameters, smoothing: float = 1e-3
) -> control.NonlinearIOSystem:
    """Return the whole equation as an input/output system, from command to angle and velocity.

    Parameters
    ----------
    parameters
        Of the hand with what it carries; the delay is left out.
    smoothing
        Velocity in rad/s over which Coulomb friction changes its sign; python-control's solvers
        need a continuous right-hand side, so it creeps at rest.
    """
    p = parameters

    def update(_: float, state: NDArray[np.float64], command: Any, __: Any) -> list[float]:  # noqa: ANN401
        x, v = float(state[0]), float(state[1])
        torque = p.p4 * float(np.ravel(command)[0]) + pull(p, x)
        torque -= (p.p2 + p.drag * abs(v)) * v + p.level(v) * math.tanh(v / smoothing)
        return [v, torque / p.p1]

    return control.nlsys(
        update,
        lambda _t, state, _command, _parameters: state,
        inputs=["command"],
        outputs=["angle", "velocity"],
        states=["angle", "velocity"],
        name="hand",
    )
