"""What the pages show between marks is what the program prints, digits that noise moves apart."""

import importlib.util
import os
import re

import pytest

from tests.pages.blocks import PAGES, ROOT

_SPEC = importlib.util.spec_from_file_location("outputs", ROOT / "docs/site/outputs.py")
outputs = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(outputs)

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
LOGS = ROOT.parent / "shared/data/strangers"
MARKED = [page for page in PAGES if outputs.MARK.search((ROOT / page).read_text(encoding="utf-8"))]


@pytest.mark.slow
@pytest.mark.parametrize("page", MARKED)
def test_a_page_shows_what_the_program_prints(page, monkeypatch):
    monkeypatch.setenv("BUTTERFLY_STRANGERS", os.environ.get("BUTTERFLY_STRANGERS") or str(LOGS))
    shown = (ROOT / page).read_text(encoding="utf-8")
    printed = outputs.written(shown)
    assert _NUMBER.sub("#", shown) == _NUMBER.sub("#", printed)
    before, now = ([float(each) for each in _NUMBER.findall(text)] for text in (shown, printed))
    assert before == pytest.approx(now, rel=0.1, abs=0.05)
