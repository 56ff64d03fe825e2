"""Of several descents the best end is kept, and an end elsewhere is said."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from butterfly.errors import IdentifiabilityError
from butterfly.identification.diagnostics.findings import FindingKind
from butterfly.identification.estimators.multistart import Multistart
from butterfly.verdict import Level


def _problem(name):
    return SimpleNamespace(name=name, initial=name)


def _end(cost, *, converged=True):
    return SimpleNamespace(point="on", at=SimpleNamespace(cost=cost), converged=converged)


class Descents:
    """Ends by the name of the problem: at a glance, and when gone on with; costs are costs."""

    def __init__(self, **ends):
        self._ends, self.made = ends, []

    def descend(self, problem, initial, known=None, most=None):
        first, *further = self._ends[problem.name]
        self.made.append((problem.name, initial, most is not None))
        if first is None:
            raise IdentifiabilityError(problem.name)
        return first if known is None else further[0]


def _ends(**ends):
    descents = Descents(
        **{name: each if isinstance(each, tuple) else (each,) for name, each in ends.items()}
    )
    return Multistart.of([_problem(name) for name in ends], descents), descents.made


def test_the_lowest_end_is_kept_and_a_higher_one_said():
    best, _ = _ends(a=_end(3.0), b=_end(2.0))
    assert (best.problem.name, best.end.at.cost) == ("b", 2.0)
    (said,) = best.findings
    assert (said.kind, said.severity) == (FindingKind.OTHER_END, Level.NOTE)
    assert said.number == pytest.approx(1.5)


def test_of_several_other_ends_the_nearest_is_said():
    best, _ = _ends(a=_end(2.0), b=_end(8.0), c=_end(5.0))
    assert [each.number for each in best.findings] == [2.5]


def test_the_same_end_twice_is_not_said():
    best, _ = _ends(a=_end(2.0), b=_end(2.08))
    assert best.findings == ()


def test_a_descent_that_is_not_lower_at_a_glance_is_given_up_without_a_word():
    best, made = _ends(a=_end(2.0), b=_end(9.0, converged=False))
    assert best.problem.name == "a"
    assert best.findings == ()
    assert made == [("a", "a", False), ("b", "b", True)]


def test_one_that_is_lower_at_a_glance_is_gone_on_with():
    best, made = _ends(a=_end(2.0), b=(_end(1.5, converged=False), _end(1.0)))
    assert (best.problem.name, best.end.at.cost) == ("b", 1.0)
    assert made == [("a", "a", False), ("b", "b", True), ("b", "on", False)]


def test_a_first_guess_that_cannot_be_simulated_is_passed_over():
    best, _ = _ends(a=(None,), b=_end(2.0))
    assert best.problem.name == "b"
    assert best.findings == ()
    with pytest.raises(IdentifiabilityError, match="a"):
        _ends(a=(None,), b=(None,))
