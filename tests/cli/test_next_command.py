"""After an answer there is one command to paste: it mends what is wrong, or uses the answer."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from butterfly.cli.next_command import next_command
from butterfly.identification.estimators import HarmonicBalance, OutputError
from butterfly.identification.fit import MissingTerms
from butterfly.identification.trust import Finding, FindingKind
from butterfly.identification.unit_errors import UnitError, unit_error
from tests.report.setting import estimate_with

_CALL = "identify --units=time=ms,angle=rad a.csv"


@pytest.mark.parametrize(
    ("findings", "missing", "saved", "command"),
    [
        ((), (), None, f"{_CALL} --terms '' --save joint.json"),
        ((), ("drag",), None, f"{_CALL} --terms drag"),
        ((), ("spring",), None, "identify a.csv --terms spring"),
        ((), (), "my joint.json", "validate 'my joint.json'"),
        ((Finding(FindingKind.POOR_FIT, number=3.0),), (), None, "inspect a.csv"),
        ((Finding(FindingKind.POOR_FIT, ("weak-form",), number=3.0),), (), None,
         "identify a.csv --method weak-form"),
        ((unit_error(UnitError.DEGREES, 0.0175),), ("drag",), None,
         "identify --units time=ms,angle=deg a.csv --terms ''"),
    ],
)  # fmt: skip
def test_the_next_command_is_a_command_to_paste(findings, missing, saved, command):
    residuals = SimpleNamespace(missing=MissingTerms(terms=missing))
    made_by = HarmonicBalance(terms=()) if missing == ("spring",) else OutputError(terms=())
    found = SimpleNamespace(estimate=estimate_with(*findings), residuals=residuals, made_by=made_by)
    words = ("identify", "--units=time=ms,angle=rad", "a.csv", "--terms", "")
    step = next_command(found, words, [Path("a.csv")], saved and Path(saved))
    assert step == f"butterfly {command}"
