"""What is left over is named by a term that is missing, and by none that is there."""

from __future__ import annotations

import numpy as np
import pytest

from butterfly.identification.diagnostics.residuals import ResidualEquations, summarise_residuals

COUNT = 4000
LEAST = 5e-3


def _balance(left, rng, *, noise=0.0, known=None, drag=None, stribeck=None):
    white = rng.standard_normal((COUNT, 3))
    return ResidualEquations(
        left=left + noise * rng.standard_normal(COUNT),
        known=white[:, :1] if known is None else known,
        candidates={
            "drag": white[:, 1] if drag is None else drag,
            "stribeck": white[:, 2] if stribeck is None else stribeck,
        },
        whole=1.0,
        noise=noise,
    )


def test_the_share_of_a_missing_term_is_that_of_its_variance():
    """left = -0.3 drag + noise of 0.1: 0.09 of 0.10 of the variance."""
    rng = np.random.default_rng(0)
    drag = rng.standard_normal(COUNT)
    overall, (own,) = summarise_residuals([_balance(-0.3 * drag, rng, noise=0.1, drag=drag)], LEAST)
    assert own == overall
    assert overall.terms == ("drag",)
    assert overall.shares["drag"] == pytest.approx(0.9, abs=0.01)
    assert overall.size == pytest.approx(0.3, rel=0.03)
    assert overall.noise == pytest.approx(0.1, abs=0.01)
    assert overall.words("the motion").startswith("quadratic drag (90 % of its variance, 30 %")


def test_a_term_that_would_push_is_not_named():
    rng = np.random.default_rng(1)
    drag = rng.standard_normal(COUNT)
    overall, _ = summarise_residuals([_balance(0.3 * drag, rng, drag=drag)], LEAST)
    assert overall.shows
    assert overall.terms == ()
    assert overall.looks_like == "no missing term of the table"


def test_what_the_model_s_own_terms_would_take_is_not_left_over():
    rng = np.random.default_rng(2)
    known = rng.standard_normal((COUNT, 2))
    balance = _balance(known @ [0.5, -2.0], rng, noise=0.01, known=known)
    overall, _ = summarise_residuals([balance], LEAST)
    assert overall.looks_like == "nothing that the data can show"
    assert overall.relative == pytest.approx(0.01, rel=0.05)


def test_a_term_like_one_of_the_model_s_counts_by_what_is_new_of_it():
    rng = np.random.default_rng(3)
    known, new = rng.standard_normal((COUNT, 1)), rng.standard_normal(COUNT)
    drag = 10 * known[:, 0] + new
    balance = _balance(-0.2 * new, rng, noise=0.001, known=known, drag=drag)
    overall, _ = summarise_residuals([balance], LEAST)
    assert overall.terms == ("drag",)
    assert overall.size == pytest.approx(0.2, rel=0.05)


def test_terms_that_look_alike_are_both_named():
    rng = np.random.default_rng(4)
    drag = rng.standard_normal(COUNT)
    alike = drag + 0.1 * rng.standard_normal(COUNT)
    balance = _balance(-0.3 * drag, rng, noise=0.05, drag=drag, stribeck=alike)
    assert summarise_residuals([balance], LEAST)[0].terms == ("drag", "stribeck")


def test_noise_alone_is_seldom_called_a_term():
    rng = np.random.default_rng(5)
    named = sum(
        bool(summarise_residuals([_balance(np.zeros(COUNT), rng, noise=1.0)], LEAST)[0].terms)
        for _ in range(100)
    )
    assert named <= 2


def test_one_cause_is_found_in_all_logs_together_though_none_shows_it():
    """Per log the missing torque is proportional to a known one, by a factor of its own."""
    rng = np.random.default_rng(6)
    balances = []
    for speed in (1.0, 2.0, 3.0):
        velocity = speed * rng.standard_normal(COUNT)
        drag = speed * velocity
        balances.append(_balance(-0.1 * drag, rng, noise=0.01, known=velocity[:, None], drag=drag))
    overall, each = summarise_residuals(balances, LEAST)
    assert overall.terms == ("drag",)
    assert summarise_residuals(balances[:1], LEAST)[0].terms == ()
    assert len(each) == 3
