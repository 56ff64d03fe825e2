"""Estimators by the names of their methods."""

import pytest

from butterfly.errors import InputError
from butterfly.experiment.methods import make_estimator
from butterfly.experiment.source import read_experiment
from butterfly.identification.estimators import Loss, OutputError, WeakForm
from butterfly.thesis.method import Thesis
from tests.experiment.setting import QUICKSTART, written


def test_estimators_have_the_options_of_their_method_and_a_shorthand_for_one(tmp_path):
    listed = [
        {"method": "output-error", "terms": ["drag"], "per_mass": ["zero"], "loss": "huber"},
        {"method": "thesis", "decimation": 5},
        {"terms": ["load"]},
    ]
    several = read_experiment(written(tmp_path / "e.yaml", **QUICKSTART, estimators=listed))
    assert several.all_estimators == (
        OutputError(terms=("drag",), per_mass=("zero",), loss=Loss.HUBER),
        Thesis(decimation=5),
        OutputError(terms=("load",)),
    )
    short = written(tmp_path / "f.yaml", **QUICKSTART, method="weak-form", terms=[])
    assert read_experiment(short).all_estimators == (WeakForm(terms=()),)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"loss": "hubble"}, "output-error: loss: got 'hubble'; expected '"),
        ({"terms": ["drag", 3]}, "output-error: terms.1: got 3; expected a valid string"),
        ({"terms": ["dragon"]}, "output-error: terms: got dragon; expected 'drag' (did you"),
    ],
)
def test_a_wrong_option_is_refused_as_in_a_file(options, message):
    with pytest.raises(InputError) as caught:
        make_estimator("output-error", options)
    assert str(caught.value).startswith(message)
