"""What tests of several pages share: odd texts, a parameter, an estimate, curves as drawn."""

from dataclasses import replace

import numpy as np

from butterfly.identification.trust import Ending, Parameter
from tests.identification.simulated import estimate_of

ODD = ("a$b", r"$\frac{$ <b>bold</b>", "<script>alert(1)</script>")


def unpacked(curve):
    """As the page's script unpacks a curve."""
    steps = [0 if step is None else step for step in curve["steps"]]
    numbers = curve["begin"] + curve["quantum"] * np.cumsum(steps)
    return np.where([step is None for step in curve["steps"]], np.nan, numbers)


def assert_seen(found, expected):
    """Check that no eye sees a difference: a line is wider."""
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    there = np.asarray(expected)[np.isfinite(expected)]
    reach = np.ptp(there) if there.size else 0.0
    np.testing.assert_allclose(found, expected, atol=1e-4 * reach, rtol=1e-12)


def parameter_row(**numbers):
    """A parameter of a table."""
    about = {"name": "p2", "meaning": "friction", "unit": "N m s/rad", "standard_error": 0.1}
    return Parameter(**about | numbers)


def estimate_with(*findings, ending=Ending.CONVERGED, reach=0.05, **more):
    """Return an estimate whose limits lie some share of its values off."""
    values = np.array([2e-3, 1e-3, 0.5, 1e-4])
    shares = np.broadcast_to(reach, values.shape)
    plain = estimate_of(values, np.diag((shares * values / 2) ** 2), reach=2)
    names = ("p1", "p2", "p4", "coulomb")
    return replace(plain, names=names, findings=findings, ending=ending, **more)
