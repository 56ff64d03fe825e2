"""`bf.changed`: what is said of two identifications of one robot."""

from dataclasses import replace

import numpy as np
import pytest

import butterfly as bf
from butterfly.api.identification import Identification
from butterfly.identification.trust import Ending
from tests.comparison.test_answers import ERRORS, TRUTH, estimate, of_scale


def identified(factors=1.0, covariance=None, **properties):
    """Return an identification with values that are the true ones, times factors."""
    spread = np.diag(ERRORS**2) if covariance is None else covariance
    origin = {"name": "set", "description": "", "input": "torque", "logs": 1, "manifest": None}
    about = {"estimate": estimate(TRUTH * factors, spread), "estimator": "any", "origin": origin}
    about |= {"fits": {"log": 99.0}, "saved": {"summary": ()}}
    return Identification(**about | properties)


def test_the_answer_comes_first_in_words():
    still = bf.changed(identified(), identified())
    assert still.summary[0].startswith(
        "No significant change. Detectable with 80 % power: 10 % in "
    )
    worn = bf.changed(identified(), identified([1, 1, 1, 1, 1.32, 1]))
    assert worn.summary[0] == (
        "Coulomb friction has increased by 32 % (from 0.001000 to 0.001320 N m). No other "
        "change is significant."
    )
    assert max(map(len, worn.shown_lines())) < 78
    shrunk = bf.changed(identified(), identified([1, 1, 0.8, 1, 1, 1]))
    assert "The gravity moment p3 has decreased by 20 %" in shrunk.summary[0]
    near = of_scale(0.999)
    ratio = bf.changed(identified(1.0, near), identified([1, 1, 1.02, 1, 1, 1], near))
    assert "The joint has changed" in ratio.summary[0]
    assert "the ratio p3/p1 has increased by 2" in ratio.summary[0]


def test_what_else_may_make_a_difference_is_said():
    bad = identified(estimate=replace(identified().estimate, ending=Ending.STOPPED))
    said = bf.changed(identified(), bad).summary
    assert said[0].startswith(
        "Do not rely on this: do not use the second result. No significant change"
    )
    assert any("Verdict on the second result: Do not use" in each for each in said)
    other = bf.changed(identified(), identified(estimator="another"))
    assert any("Different estimators" in each for each in other.summary)
    held = [
        identified(estimate=replace(identified().estimate, fixed={"bias": value}))
        for value in (0.0, 0.1)
    ]
    assert any("Fixed at different values: bias" in each for each in bf.changed(*held).summary)


def test_what_cannot_be_compared_is_refused():
    volts = identified().origin | {"input": "voltage"}
    with pytest.raises(bf.InputError, match="torque, as in the first result"):
        bf.changed(identified(), identified(origin=volts))
    with pytest.raises(bf.InputError, match="an identification"):
        bf.changed(identified(), 3)
