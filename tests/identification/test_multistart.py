"""Of several descents the best end is kept, and an end elsewhere is said."""

from types import SimpleNamespace

import numpy as np
import pytest

from butterfly.errors import IdentifiabilityError
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.estimators.gauss_newton import Equations, LogEquations
from butterfly.identification.estimators.multistart import lowest_end


class Problem:
    """What descends to given ends: at a glance, and when gone on with; None cannot be simulated."""

    initial = "start"

    def __init__(self, *ends):
        self.ends, self.made = ends, []

    def descend(self, initial, known=None, most=None):
        self.made.append((initial, most is not None))
        if self.ends[0] is None:
            raise IdentifiabilityError("diverges")
        return self.ends[0 if known is None else 1]


def _end(cost, *, converged=True):
    return SimpleNamespace(point="on", at=SimpleNamespace(cost=cost, logs=()), converged=converged)


FULLY, GLANCE, ON = ("start", False), ("start", True), ("on", False)


@pytest.mark.parametrize(
    ("ends", "cost", "ratios", "last"),
    [
        pytest.param([[_end(3)], [_end(2)]], 2, [1.5], [GLANCE], id="a-higher-end-is-said"),
        pytest.param([[_end(2)], [_end(8)], [_end(5)]], 2, [2.5], [GLANCE], id="the-nearest-is"),
        pytest.param([[_end(2)], [_end(2.08)]], 2, [], [GLANCE], id="the-same-twice-is-not"),
        pytest.param(
            [[_end(2)], [_end(9, converged=False)]], 2, [], [GLANCE], id="not-lower-is-given-up"
        ),
        pytest.param(
            *([[_end(2)], [_end(1.5, converged=False), _end(1)]], 1, [2.0], [GLANCE, ON]),
            id="lower-is-gone-on-with",
        ),
        pytest.param([[None], [_end(2)]], 2, [], [FULLY], id="no-simulation-is-passed-over"),
    ],
)
def test_the_lowest_end_is_kept_and_other_ends_said(ends, cost, ratios, last):
    problems = [Problem(*each) for each in ends]
    problem, end, findings = lowest_end(problems)
    assert end.at.cost == cost
    assert end in problem.ends
    assert problems[0].made == [FULLY]
    assert problems[-1].made == last
    assert [each.number for each in findings] == ratios
    for each in findings:
        assert each.kind is FindingKind.OTHER_END


def test_guesses_none_of_which_can_be_simulated_are_refused():
    with pytest.raises(IdentifiabilityError, match="diverges"):
        lowest_end([Problem(None), Problem(None)])


@pytest.mark.parametrize(
    ("noise", "wave", "made"), [(1e-3, 0.0, 1), (1e-3, 1e-3, 2), (0.1, 0.0, 2)]
)
def test_no_other_start_is_made_where_the_first_leaves_small_white_errors_alone(noise, wave, made):
    """Smooth errors of the size of noise, or large ones, may have another end."""
    errors = noise * np.random.default_rng(0).standard_normal(4000)
    errors += wave * np.sqrt(2) * np.sin(np.arange(4000) / 50)
    log = LogEquations(residuals=errors / 4000**0.5, rows=np.ones((4000, 1)), mixture=np.eye(1))
    first = SimpleNamespace(point="on", at=Equations(logs=(log,)), converged=True)
    problems = []

    def later():
        for ends in ([first], [_end(5)]):
            problems.append(Problem(*ends))
            yield problems[-1]

    lowest_end(later(), enough=True)
    assert len(problems) == made
    lowest_end(later())
    assert len(problems) == made + 2
