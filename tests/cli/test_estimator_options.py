"""Every option of every estimator can be said on the command line, and no other."""

from dataclasses import fields

import pytest

from butterfly.cli.derived import texts_of
from butterfly.cli.estimator_options import FitOfOne, FitOfSeveral, FitOfTerms, Terms, Tuning
from butterfly.errors import InputError
from butterfly.experiment.methods import ESTIMATORS
from butterfly.identification.estimators import Loss

HELP = texts_of(Tuning) | texts_of(Terms) | texts_of(FitOfOne)
OWN = {
    method: [each.name for each in fields(kind) if each.name != "method"]
    for method, kind in ESTIMATORS.items()
}
SAID = {"cogging_periods": 3.0, "servo_loop": "open", "window": 12.5, "horizon": 1.5}
SAID |= {"half_width": 0.1, "workers": 2, "decimation": 5}
SAID = {name: (value, value) for name, value in SAID.items()}
SAID |= {"terms": ("drag, stribeck", ("drag", "stribeck")), "fixed": ("p2,delay", ("p2", "delay"))}
SAID |= {"per_mass": ("bias", ("bias",)), "per_log": ("zero,velocity", ("zero", "velocity"))}
SAID |= {"loss": ("cauchy", Loss.CAUCHY)}
"""What is said of each option, and what the estimator is to make of it."""
PAIRS = [(method, name) for method, own in OWN.items() for name in own]


@pytest.mark.parametrize(("method", "name"), PAIRS)
def test_every_option_of_every_estimator_can_be_said(method, name):
    said, meant = SAID[name]
    assert FitOfOne(method=method, **{name: said}).estimator() == ESTIMATORS[method](
        **{name: meant}
    )


def test_nothing_said_is_every_estimator_s_default():
    for method, kind in ESTIMATORS.items():
        assert FitOfOne(method=method).estimator() == kind()
    assert FitOfOne().keywords() == {}
    assert FitOfOne(terms="").keywords() == {"terms": ()}


@pytest.mark.parametrize(
    ("method", "name"),
    [(method, name) for method in ESTIMATORS for name in SAID if (method, name) not in PAIRS],
)
def test_an_option_of_another_estimator_is_refused_with_the_valid_ones(method, name):
    with pytest.raises(InputError) as refused:
        FitOfOne(method=method, **{name: SAID[name][0]}).estimator()
    text = str(refused.value)
    assert f"--method {method}" in text
    assert f"--{name.replace('_', '-')}" in text
    assert any(each.replace("_", "-") in text for each in OWN[method] or ["no option"])


def test_help_is_what_the_docstrings_say_with_owners_terms_and_defaults():
    assert HELP["half_width"].endswith("Only for weak-form. Default: chosen from the data.")
    assert HELP["loss"].endswith("Only for output-error. Default: linear.")
    assert "mass_inertia, stribeck" in HELP["terms"]
    assert "cogging" not in HELP["terms"]
    assert HELP["terms"].endswith("more, see docs/methods.md.")
    for name, kind in ESTIMATORS.items():
        assert f"{name}: {kind.summary}" in HELP["method"]


def test_commands_leave_out_what_they_settle():
    assert "terms" not in {each.name for each in fields(FitOfTerms)}
    assert FitOfTerms().keywords() == {}
    assert FitOfTerms(method="linear").keywords() == {"method": "linear"}
    several = FitOfSeveral(method="linear,thesis", loss="huber").keywords()
    assert several == {"method": ("linear", "thesis"), "loss": "huber"}


def test_the_help_on_terms_says_which_method_chooses_them():
    chooses = [
        method
        for method, own in OWN.items()
        if "terms" in own and ESTIMATORS[method]().terms is None
    ]
    assert chooses == ["output-error"]
    assert "Default: chosen by output-error, else none." in " ".join(HELP["terms"].split())
