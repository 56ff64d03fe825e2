"""Options of verbs: each parameter once, with the verb's default, as the verb takes it."""

from inspect import signature
from typing import get_type_hints

import pytest

import butterfly as bf
from butterfly.cli import verb_options
from butterfly.errors import InputError

OPTIONS = {
    name.removeprefix("OptionsOf").lower(): kind
    for name, kind in vars(verb_options).items()
    if name.startswith("OptionsOf")
}
OF_COMMANDS = {"pose", "method", "track", "against", "bands", "result", "others"}
"""What commands declare themselves, of all that a verb takes."""
NO_OPTIONS = {"hand_mass", "callbacks", "change", "known", "step", "options", "description"}


@pytest.mark.parametrize("name", OPTIONS)
def test_what_is_not_said_is_the_verb_s_default(name):
    parameters = signature(getattr(bf, name)).parameters
    for option, value in OPTIONS[name]().keywords().items():
        default = parameters[option].default
        assert value == (tuple(default) if isinstance(default, (list, tuple)) else default), option


@pytest.mark.parametrize("name", OPTIONS)
def test_every_parameter_of_a_verb_is_an_option_or_known_to_be_none(name):
    _, *others = signature(getattr(bf, name)).parameters
    options = [other for other in others if other not in OF_COMMANDS | NO_OPTIONS]
    assert list(OPTIONS[name]().keywords()) == options
    keywords = getattr(verb_options, f"{name.capitalize()}Keywords")
    assert list(get_type_hints(keywords)) == options


def test_lists_are_read():
    options = verb_options.OptionsOfSelect(candidates="drag, load", holdout="run1,")
    assert options.keywords() == {
        "candidates": ("drag", "load"),
        "holdout": ("run1",),
        "nested": False,
    }
    assert verb_options.OptionsOfResidual(logs="0,2").keywords()["logs"] == [0, 2]
    assert verb_options.OptionsOfCampaign(masses="0,0.1").keywords()["masses"] == [0.0, 0.1]
    with pytest.raises(InputError, match="--masses"):
        verb_options.OptionsOfCampaign(masses="heavy").keywords()


def test_the_word_of_an_option_is_its_whole_unit():
    hints = get_type_hints(verb_options.OptionsOfCampaign, include_extras=True)
    words = {
        name: declared.metavar
        for name in ("goal", "command", "speed", "current", "seconds")
        for declared in hints[name].__metadata__
    }
    assert words == {
        "goal": "SHARE",
        "command": "VALUE",
        "speed": "rad/s",
        "current": "A",
        "seconds": "s",
    }
