"""First contact finds by which sign of the command a joint turns, and what moves it."""

from dataclasses import replace

import pytest

from butterfly.campaigns.bench import ENOUGH, Bench, make_contact
from butterfly.campaigns.guard import Limits
from tests.campaigns.robots import COMMAND, TRUE, Faulty, rig


@pytest.mark.parametrize(("wrong", "polarity"), [("", 1), ("reversed", -1)])
def test_contact_finds_the_sign_and_a_command_that_just_beats_friction(wrong, polarity):
    stiff = replace(TRUE, coulomb=0.02)
    with Bench(Faulty(wrong, of=rig(true=stiff)), Limits(command=COMMAND), 0.005) as bench:
        contact = make_contact(bench)
    least = stiff.coulomb / stiff.p4
    most = least + stiff.p3 * ENOUGH / stiff.p4  # in balance where it has moved far enough
    assert contact.polarity == bench.polarity == polarity
    assert least < contact.breakaway < 1.25**2 * most  # a step of the push, and one to move
