"""The best of several descents: the lowest end, and no other where only noise is left."""

from types import SimpleNamespace

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError
from butterfly.identification.estimators.start import best_local_minimum
from butterfly.identification.fit import Fit
from butterfly.identification.trust import Ending, FindingKind
from tests.identification.simulated import equations_about


class Problem:
    """What has a cost at its guess, and descends to given ends: at a glance, and when gone on with.

    A cost that is infinite cannot be simulated.
    """

    initial = "start"

    def __init__(self, begun, *ends):
        self.begun, self.ends, self.made = begun, ends, []

    def equations(self, _):
        return SimpleNamespace(cost=self.begun, is_finite=np.isfinite(self.begun))

    def descend(self, at, most=None, enough=None):  # noqa: ARG002 - as a problem has it
        self.made.append((at.cost, most is not None))
        if not np.isfinite(self.begun):
            raise IdentifiabilityError("diverges")
        return self.ends[min(len(self.made), len(self.ends)) - 1]


def _end(cost, *, converged=True):
    ending = Ending.CONVERGED if converged else Ending.STOPPED
    return Fit(linearisation=_constant(cost), ending=ending)


def _constant(cost, errors=None):
    """Equations of one value with a cost: of smooth errors, or of given ones."""
    errors = np.full(9, np.sqrt(2 * cost / 9)) if errors is None else errors
    return equations_about(np.ones(1), errors, np.ones((errors.size, 1)))


@pytest.mark.parametrize(
    ("problems", "cost", "ratios", "last"),
    [
        pytest.param([(8, _end(3)), (9, _end(2))], 2, [1.5], [(9, True)], id="a-higher-end"),
        pytest.param([(9, _end(3)), (8, _end(2))], 2, [1.5], [(9, True)], id="the-nearer-first"),
        pytest.param([(8, _end(2)), (9, _end(2.08))], 2, [], [(9, True)], id="the-same-is-not"),
        pytest.param(
            *([(8, _end(2)), (9, _end(7, converged=False))], 2, [], [(9, True)]),
            id="not-lower-is-given-up",
        ),
        pytest.param(
            [(8, _end(2)), (9, _end(1.5, converged=False), _end(1))],
            *(1, [2.0], [(9, True), (1.5, False)]),
            id="lower-is-gone-on-with",
        ),
        pytest.param([(np.inf,), (8, _end(2))], 2, [], [], id="no-simulation-is-passed-over"),
    ],
)
def test_the_lowest_end_is_kept_and_other_ends_said(problems, cost, ratios, last):
    tried = sorted((Problem(*each) for each in problems), key=lambda each: each.begun)
    _, found = best_local_minimum([*tried[::-1]])
    assert found.cost == cost
    assert tried[0].made == [(8, False)]
    assert tried[-1].made == last
    assert [each.number for each in found.findings] == ratios
    for each in found.findings:
        assert each.kind is FindingKind.OTHER_END


def test_guesses_none_of_which_can_be_simulated_are_refused():
    with pytest.raises(IdentifiabilityError, match="diverges"):
        best_local_minimum([Problem(np.inf), Problem(np.inf)])


@pytest.mark.parametrize(
    ("noise", "wave", "made"), [(1e-3, 0.0, 0), (1e-3, 1e-3, 1), (0.1, 0.0, 1)]
)
def test_no_other_start_is_gone_on_from_where_small_white_errors_alone_are_left(noise, wave, made):
    """Smooth errors of the size of noise, or large ones, may have another end."""
    errors = noise * np.random.default_rng(0).standard_normal(4000)
    errors += wave * np.sqrt(2) * np.sin(np.arange(4000) / 50)
    first = Fit(linearisation=_constant(0.0, errors / 4000**0.5))
    other = Problem(9, _end(5))
    best_local_minimum([Problem(8, first), other])
    assert len(other.made) == made
