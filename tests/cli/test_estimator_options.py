"""Every option of every estimator can be said on the command line, and no other."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, fields
from types import SimpleNamespace

import pytest

from butterfly.cli.estimator_options import built, described, takes_estimator
from butterfly.errors import InputError
from butterfly.experiment.methods import ESTIMATORS
from butterfly.identification.estimators import Loss, OutputError, WeakForm

OWN = {
    method: [each for each in fields(kind) if each.name != "method"]
    for method, kind in ESTIMATORS.items()
}
SAID = {
    "cogging_periods": (3.0, 3.0),
    "terms": ("drag, stribeck", ("drag", "stribeck")),
    "fixed": ("p2,delay", ("p2", "delay")),
    "per_mass": ("bias", ("bias",)),
    "per_log": ("zero,velocity", ("zero", "velocity")),
    "loss": (Loss.CAUCHY, Loss.CAUCHY),
    "window": (12.5, 12.5),
    "horizon": (1.5, 1.5),
    "half_width": (0.1, 0.1),
    "check": (False, False),
    "workers": (2, 2),
    "decimation": (5, 5),
}
"""What is said of each option, and what the estimator is to make of it."""


@takes_estimator()
def _command(*, data, estimator):
    """Stand for any command."""
    return data, estimator


def _options():
    return inspect.signature(_command).parameters


@pytest.mark.parametrize(
    ("method", "name"), [(method, each.name) for method, own in OWN.items() for each in own]
)
def test_every_option_of_every_estimator_can_be_said(method, name):
    said, meant = SAID[name]
    silent = dict.fromkeys(n for n in _options() if n not in {"data", "method"})
    chosen = SimpleNamespace(value=method)
    data, estimator = _command(data="logs", method=chosen, **(silent | {name: said}))
    assert (data, type(estimator)) == ("logs", ESTIMATORS[method])
    assert estimator == ESTIMATORS[method](**{name: meant})


def test_nothing_said_is_every_estimator_s_default():
    for method, kind in ESTIMATORS.items():
        assert built(method, dict.fromkeys(SAID)) == kind()


@pytest.mark.parametrize(
    ("method", "name"),
    [(m, n) for m in ESTIMATORS for n in SAID if n not in {each.name for each in OWN[m]}],
)
def test_an_option_of_another_estimator_is_refused_with_the_valid_ones(method, name):
    with pytest.raises(InputError) as refused:
        built(method, {name: SAID[name][0]})
    text = str(refused.value)
    assert f"--method {method}" in text
    assert f"--{name.replace('_', '-')}" in text
    assert any(each.name in text for each in OWN[method])


def test_help_is_what_the_docstrings_say_and_names_the_owners():
    for method, own in OWN.items():
        said = described(ESTIMATORS[method])
        for each in own:
            assert said[each.name] in " ".join((ESTIMATORS[method].__doc__ or "").split())
    text = _options()["half_width"].annotation.__metadata__[0].help
    assert text == f"{described(WeakForm)['half_width']} Of weak-form. Default: 0.25."
    owners = _options()["loss"].annotation.__metadata__[0].help
    assert owners == f"{described(OutputError)['loss']} Of output-error. Default: linear."


def test_help_takes_the_first_sentence_and_names_the_terms_that_methods_offer():
    horizon = _options()["horizon"].annotation.__metadata__[0].help
    assert "0 for whole logs. Of output-error." in horizon
    assert "30-fold" not in horizon
    terms = _options()["terms"].annotation.__metadata__[0].help
    assert "drag, load, bias, stribeck; " in terms
    assert "stribeck_velocity, tilt (output-error)" in terms


def _shown(name):
    text = _options()[name].annotation.__metadata__[0].help
    return text.rpartition("Default: ")[2].removesuffix(".")


def test_defaults_that_differ_are_told_apart(monkeypatch):
    @dataclass(frozen=True, kw_only=True)
    class Told(WeakForm):
        __doc__ = WeakForm.__doc__
        terms: tuple[str, ...] | None = ("drag", "load")
        half_width: float = 0.125

    monkeypatch.setitem(ESTIMATORS, "weak-form", Told)
    shown = _shown_anew("terms")
    assert "harmonic-balance: chosen from the data" in shown
    assert "weak-form: drag,load" in shown
    assert _shown_anew("half_width") == "0.125"


def _shown_anew(name):
    command = takes_estimator()(lambda *, estimator: estimator)
    text = inspect.signature(command).parameters[name].annotation.__metadata__[0].help
    return text.rpartition("Default: ")[2].removesuffix(".")


def test_defaults_are_shown():
    assert _shown("terms") == "chosen from the data"
    assert _shown("fixed") == "none"
    assert _shown("loss") == "linear"


def test_an_empty_text_means_no_terms():
    assert built("weak-form", {"terms": ""}).terms == ()


def test_every_method_is_summed_up_and_what_a_command_settles_is_left_out():
    text = _options()["method"].annotation.__metadata__[0].help
    for name, kind in ESTIMATORS.items():
        assert f"{name}: {kind.summary}." in text
    without = takes_estimator(leave_out=("terms",))(lambda *, estimator: estimator)
    assert "terms" not in inspect.signature(without).parameters
