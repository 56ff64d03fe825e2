"""What is said of a slip: how to say the unit that was meant."""

import math
import re

import pytest

from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.diagnostics.unit_errors.names import Slip, slip_in_words
from butterfly.logs.units import Units
from butterfly.verdict import Level


@pytest.mark.parametrize(
    ("slip", "factor"),
    [
        (Slip.DEGREES, math.pi / 180),
        (Slip.COUNTS, 2 * math.pi / 4096),
        (Slip.MILLISECONDS, 1e-3),
        (Slip.MICROSECONDS, 1e-6),
        (Slip.PER_MINUTE, 2 * math.pi / 60),
        (Slip.HERTZ, 2 * math.pi),
        (Slip.MILLIMETRES, 1e-3),
        (Slip.CENTIMETRES, 1e-2),
        (Slip.GRAMS, 1e-3),
    ],
)
def test_the_unit_that_is_advised_has_the_factor_that_undoes_the_slip(slip, factor):
    found = Finding(kind=FindingKind.SLIP, parameters=(slip,), number=factor, severity=Level.CARE)
    said = slip_in_words(found)
    name, unit = re.search(r"--units (\w+)=(\S+), ", said).groups()
    assert f"units: {{{name}: {unit}}}" in said
    assert Units.told({name: unit}).factor(name) == pytest.approx(factor, rel=1e-12)
