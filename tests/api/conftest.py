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


OF_ESTIMATE = {
    "identification": lambda found: found,
    "physical": lambda found: found.physical(hand_mass=(0.1, 0.001), back_emf_constant=0.05),
    "validation": lambda found: bf.validate(found.data, terms=()),
    "design": bf.design,
    "comparison": lambda found: bf.compare(found, logs=[0]),
    "prediction": lambda found: bf.predict(found.data, found, bands=False),
    "draws": lambda found: bf.draws(found, 40),
    "residual": lambda found: bf.residual(found, logs=[0, 2]),
}
OTHERS = ("selection", "leaderboard", "change", "planned", "inspection", "one log", "model")


@pytest.fixture(scope="session")
def results(data, few, quick_data, tmp_path_factory):
    few.save(saved := tmp_path_factory.mktemp("few") / "few.json")
    logs = data.take([0, 2, 3, 5, 6, 8]).logs
    coarse = bf.read([log.take(np.arange(0, log.time.size, 3)) for log in logs])
    others = (
        bf.select(coarse, candidates=("drag",), nested=True),
        bf.validate(coarse, ["weak-form", "linear"]),
        bf.changed(few, few),
        bf.predict(quick_data.parent / "quick.yaml", few, bands=False),
        bf.inspect(quick_data),
        bf.inspect(quick_data, logs=[2]),
        bf.inspect(saved),
    )
    return results_of(few) | dict(zip(OTHERS, others, strict=True))


def results_of(found):
    """Return a result of each kind that rests on an identification."""
    return {kind: make(found) for kind, make in OF_ESTIMATE.items()}
