"""What is said of a slip: how to say the unit that was meant."""

import math
import re

import pytest

from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.diagnostics.unit_errors import UnitError, unit_error_text
from butterfly.logs.units import Units
from butterfly.verdict import Level


@pytest.mark.parametrize(
    ("slip", "factor"),
    [
        (UnitError.DEGREES, math.pi / 180),
        (UnitError.COUNTS, 2 * math.pi / 4096),
        (UnitError.MILLISECONDS, 1e-3),
        (UnitError.MICROSECONDS, 1e-6),
        (UnitError.PER_MINUTE, 2 * math.pi / 60),
        (UnitError.HERTZ, 2 * math.pi),
        (UnitError.MILLIMETRES, 1e-3),
        (UnitError.CENTIMETRES, 1e-2),
        (UnitError.GRAMS, 1e-3),
    ],
)
def test_the_unit_that_is_advised_has_the_factor_that_undoes_the_slip(slip, factor):
    found = Finding(FindingKind.UNIT_ERROR, (slip,), number=factor, severity=Level.CARE)
    said = unit_error_text(found)
    name, unit = re.search(r"--units (\w+)=(\S+), ", said).groups()
    assert f"units: {{{name}: {unit}}}" in said
    assert Units.of({name: unit}).factor(name) == pytest.approx(factor, rel=1e-12)
