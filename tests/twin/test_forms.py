"""What every form of an exported joint says."""

import re
from dataclasses import replace

import pytest

from butterfly.logs.log import InputKind
from butterfly.twin.forms import FORMS, Options, write_as
from tests.twin.alone import BRIEF, PLAIN, twin_of


@pytest.mark.parametrize("form", FORMS)
def test_every_form_says_how_the_encoder_s_angle_follows_from_its_own(form):
    zeros = (0.25, 0.26) if form == "c" else (0.25,)
    twin, asked = twin_of(PLAIN, BRIEF, kind=InputKind.VOLTAGE), Options(actuator="mx64")
    said = "Encoder's angle = angle here + zero; zero = 0.25 rad in the logs"
    if form == "compensation":  # has the encoder's angle itself
        said = "Angles are the encoder's; its zero was 0.25 rad in the logs: set yours (zero)."
    told, silent = (write_as(form, replace(twin, zeros=each), asked).text for each in (zeros, ()))
    assert said.replace("0.25", "0.25 to 0.26" if form == "c" else "0.25") in told
    assert "ncoder's" not in silent
    assert form != "compensation" or "0.25, /* zero */" in told


@pytest.mark.parametrize("form", sorted({*FORMS} - {"bam", "compensation", "wpilib"}))
def test_a_joint_that_nothing_drives_is_exported_too(form):
    written = write_as(form, twin_of(replace(PLAIN, p4=0.0)))
    assert written.text
    assert written.accuracy is None or written.accuracy.worst < 1e-4
    says_so = "p4 is unknown" in " ".join(written.left_out)
    assert says_so or form not in {"snippet", "urdf", "actuator"}


@pytest.mark.parametrize("form", ["mjcf", "snippet", "urdf"])
def test_hyphens_of_a_name_end_no_comment(form):
    text = write_as(form, replace(twin_of(PLAIN), name="a--b---c")).text
    assert not any("--" in each for each in re.findall(r"<!--(.*?)-->", text, re.DOTALL))
