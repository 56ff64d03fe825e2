"""Estimators by the names of their methods."""

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
