"""What linear equations promise of starts, removals and rivals is simulated, or not believed."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.identification.chosen_terms import FreeRunModel
from butterfly.identification.data import DataSet
from butterfly.identification.estimators import OutputError
from butterfly.identification.estimators.start import starts
from butterfly.identification.fit import Box
from butterfly.identification.stagewise import is_near, stagewise
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from tests.identification.test_stiff_trials import JOINT, MASS, recorded

TERMS = ("drag", "stribeck")
PLAIN = OutputError(terms=TERMS, workers=1, horizon=float("inf"))


def _problem():
    """Return the problem of four logs of a joint without either of two terms."""
    logs = [recorded(mass=mass, seed=k) for k, mass in enumerate([NO_ADDED_MASS, MASS] * 2)]
    data = DataSet.of([replace(log, name=f"log {k}") for k, log in enumerate(logs)])
    return PLAIN.problem(data.logs, starts(data, ())[0], data.known)


@pytest.fixture(scope="module")
def model():
    """The fit without terms."""
    every = _problem()
    return FreeRunModel(every=every, fit=every.without(set(TERMS)).descend(), rows=TERMS)


@pytest.mark.parametrize(
    ("moved", "confirmed"),
    [
        ({}, True),
        ({"p2": 1.000001}, True),
        ({"p2": 1.5}, False),  # plausible, and simulated it does not follow the logs
        ({"p1": 1.5}, False),
        ({"p1": 1e-3}, False),
        ({"p1": 11.0}, False),
        ({"p4": np.nan}, False),
        ({"p3": np.inf}, False),
    ],
)
def test_a_rival_is_believed_once_its_simulation_is_as_good(model, moved, confirmed):
    rival = {name: value * moved.get(name, 1.0) for name, value in model.fit.named.items()}
    assert model.confirms(rival) is confirmed


def test_a_rival_with_another_term_is_simulated_with_it(model):
    here = model.fit.named
    assert model.confirms(here | {"drag": 0.0})
    assert not model.confirms(here | {"drag": 0.1 * here["p2"]})


def test_an_inertia_that_no_simulation_ends_with_is_not_simulated(model, monkeypatch):
    def refuse(*_):
        pytest.fail("it was simulated")

    monkeypatch.setattr(FreeRunModel, "equations", refuse)
    assert not model.confirms(model.fit.named | {"p1": 1e-5 * model.fit.named["p1"]})


@given(st.floats(1e-3, 1e3), st.floats(-0.5, 2.0), st.lists(st.floats(0.0, 0.1), min_size=1))
def test_near_is_within_ten_times_the_least_inertia_that_a_mass_leaves(ratio, bare, carried):
    masses = [AddedMass(mass=each, arm=1.0) for each in carried]  # so that m l^2 is m
    least = min(carried)
    here = {"p1": bare - least if bare > 1e-3 else 1.0}
    there = {"p1": ratio * (here["p1"] + least) - least}
    found = is_near(there, here, masses)
    if abs(np.log10(ratio)) < 0.999:
        assert found
    if abs(np.log10(ratio)) > 1.001:
        assert not found


def test_a_removal_whose_linear_start_is_impossible_begins_at_the_fit(model, monkeypatch):
    more = model.every.without({"stribeck"})
    fit = replace(model, fit=more.descend())
    sound = fit.without(["drag"])
    submodels = type(fit.nested)
    right = submodels.fitted
    for wrong in (np.nan, -1.0, 1e-6):

        def astray(self, kept, wrong=wrong):
            values = right(self, kept)
            values[:, self.names.index("p1")] = wrong
            return values

        monkeypatch.setattr(submodels, "fitted", astray)
        fewer = fit.without(["drag"])
        assert fewer.fit.values == pytest.approx(sound.fit.values, rel=1e-4)


def test_terms_on_their_bound_leave_a_fit_that_began_with_them():
    """About no Stribeck friction the equations of its velocity are empty."""
    every = _problem()
    place = every.labels.index("stribeck")
    end = every.descend()
    values = end.values.copy()
    values[place] = every.lower[place]
    at = every.equations(values)
    begun = FreeRunModel(every=every, fit=replace(end, linearisation=at), rows=TERMS)
    found = stagewise(begun, TERMS, ()).model
    assert not {"stribeck", "stribeck_velocity"} & {*found.problem.names}
    for name in ("p1", "p2", "p3", "p4"):
        assert found.fit.named[name] == pytest.approx(getattr(JOINT, name), rel=0.02)


@given(st.floats(1e-6, 1e3), st.floats(0.0, 10.0))
def test_a_step_takes_a_value_nine_tenths_of_the_way_to_its_origin_at_most(value, carried):
    box = Box(np.array([-np.inf]), origin=np.array([-carried]))
    lowest, highest = box.about(np.array([value]), np.inf)
    assert value + lowest[0] + carried >= 0.1 * (value + carried) * (1 - 1e-6)
    assert highest[0] == np.inf


def test_no_step_of_a_problem_takes_the_inertia_with_its_lightest_mass_to_nothing():
    problem = _problem()
    first = problem.labels.index("p1")
    lowest, _ = problem.box.about(problem.initial, np.inf)
    assert problem.initial[first] + lowest[first] >= 0.0999 * problem.initial[first]
    assert (np.delete(lowest, first) <= 0).all()
