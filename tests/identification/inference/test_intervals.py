"""Limits against Student's distribution."""

from __future__ import annotations

import numpy as np
from scipy.stats import t as student

from butterfly.identification.inference.covariance import CONFIDENCE, honest_limits

VALUES = np.array([1.0, -2.0])
COVARIANCE = np.array([[0.04, 0.01], [0.01, 0.09]])
FREEDOM = np.array([3.0, 20.0])


def test_limits_are_student_s_at_95_per_cent():
    lower, upper = honest_limits(VALUES, COVARIANCE, FREEDOM, [])
    low, high = student.interval(0.95, FREEDOM, VALUES, np.sqrt(np.diag(COVARIANCE)))
    np.testing.assert_allclose(lower, low)
    np.testing.assert_allclose(upper, high)
    assert CONFIDENCE == 0.95


def test_they_are_widened_to_hold_estimates_of_partial_data_and_never_narrowed():
    plain = honest_limits(VALUES, COVARIANCE, FREEDOM, [])
    left_out = [np.array([5.0, -2.1]), np.array([0.9, -9.0])]
    lower, upper = honest_limits(VALUES, COVARIANCE, FREEDOM, left_out)
    assert upper.tolist() == [5.0, plain[1][1]]
    assert lower.tolist() == [plain[0][0], -9.0]
