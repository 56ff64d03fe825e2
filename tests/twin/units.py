"""Units of a product, as they are identified: with an interval."""

from dataclasses import replace

import numpy as np

from butterfly.identification.estimate import Estimate
from butterfly.model.parameters import LumpedParameters
from butterfly.verdict import SPREADS
from tests.twin.moving import PARAMETERS, twin


def estimated(joint, **half_widths):
    """The same joint with half-widths of intervals."""
    names = tuple(half_widths)
    values = np.array([getattr(joint.parameters, name) for name in names])
    half = np.array([*half_widths.values()])
    errors = np.where(np.isfinite(half), half, 0.0) / SPREADS
    estimate = Estimate(
        method="told",
        names=names,
        values=values,
        covariance=np.diag(errors**2),
        lower=values - half,
        upper=values + half,
        fixed={},
    )
    return replace(joint, estimate=estimate)


def unit_of_product(**values):
    """A unit with these parameters, each known within 5 %."""
    parameters = PARAMETERS | {"coulomb": 2e-3} | values
    joint = twin(parameters=LumpedParameters(**parameters))
    return estimated(joint, **{name: 0.05 * value for name, value in parameters.items()})
