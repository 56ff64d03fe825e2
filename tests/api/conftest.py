"""One data set, what is identified from it, and every kind of result that rests on that."""

import numpy as np
import pytest

import butterfly as bf

WRONG = {"p1": 0.004, "p2": 0.0015, "p3": 0.05}


@pytest.fixture(scope="session")
def data(quick_data):
    return bf.read(quick_data)


@pytest.fixture(scope="session")
def result(data):
    return bf.identify(data, against={"wrong": WRONG})


@pytest.fixture(scope="session")
def few(data):
    """What is identified from four logs."""
    return bf.identify(data.take([0, 2, 3, 5]), terms=())


@pytest.fixture(scope="session")
def predicted(data, result):
    return bf.predict(data, result, draws=60)


@pytest.fixture(scope="session")
def results(few, quick_data):
    coarse = bf.read([log.take(np.arange(0, log.time.size, 3)) for log in few.data.logs])
    return results_of(few) | {
        "selection": bf.select(coarse, "weak-form", candidates=("drag",)),
        "leaderboard": bf.validate(coarse, ["weak-form", "linear"]),
        "change": bf.changed(few, few),
        "planned": bf.predict(quick_data.parent / "quick.yaml", few, bands=False),
    }


def results_of(found):
    """Return a result of each kind that rests on an identification."""
    return {
        "identification": found,
        "physical": found.physical(hand_mass=(0.1, 0.001), back_emf_constant=0.05),
        "validation": bf.validate(found.data, terms=()),
        "design": bf.design(found),
        "comparison": bf.compare(found, logs=[0]),
        "prediction": bf.predict(found.data, found, bands=False),
        "draws": bf.draws(found, 40),
        "residual": bf.residual(found, logs=[0, 2]),
    }
