"""What docs/python.md and README show from Python runs as it is printed."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"```python\n(.*?)```", re.DOTALL)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["docs/python.md", "README.md"])
def test_every_block_runs_as_printed(name, quick, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = BLOCK.findall((ROOT / name).read_text(encoding="utf-8"))
    assert blocks
    names = {}
    for block in blocks:
        brief = block.replace('"quickstart"', repr(str(quick)))
        exec(compile(brief, name, "exec"), names)  # noqa: S102 - our own documents
    assert (tmp_path / "report.html").exists()
