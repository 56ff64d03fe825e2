"""The C programs of docs/twin.md compile with the headers that its commands export, and run."""

import pytest

import butterfly as bf
from tests.pages.blocks import ROOT, blocks_of
from tests.programs import said
from tests.twin.compiled import compile_with, needs_cc

PAGE = "docs/twin.md"
PROGRAMS = [block.text for block in blocks_of(PAGE) if block.language == "c"]
EXPORTS = [
    command
    for block in blocks_of(PAGE)
    for command in block.commands
    if "--to c " in command or "--to compensation " in command
]


@pytest.fixture
def exported(quick_data, butterfly, tmp_path, monkeypatch):
    """The folder of somebody's robot, named as on the page, with what its commands export."""
    monkeypatch.chdir(tmp_path)
    data = bf.read(quick_data, name="my-robot")
    bf.identify(data, method="weak-form").save("result.json")
    for command in EXPORTS:
        code, out, err = butterfly(*command.split()[1:])
        assert code == 0, err
        assert "my_robot_" in out
    return tmp_path


@needs_cc
@pytest.mark.usefixtures("brief_twins")
def test_the_programs_on_the_page_compile_with_what_is_exported_and_run(exported):
    assert len(PROGRAMS) == len(EXPORTS) == 2
    for number, program in enumerate(PROGRAMS):
        source, compiled = exported / f"{number}.c", exported / f"{number}.o"
        source.write_text(program, encoding="utf-8")
        compile_with("cc", "-std=c99", "-c", source, "-o", compiled)
        if "main(" in program:
            said("cc", compiled, "-o", exported / "run", "-lm")
            angle, velocity = (float(x.split()[0]) for x in said(exported / "run").split(", "))
            assert 0 < angle < 10
            assert abs(velocity) < 100


def test_the_page_includes_the_files_that_its_commands_write():
    written = [command.split()[-1] for command in EXPORTS]
    assert [ROOT.joinpath(name).suffix for name in written] == [".h", ".h"]
    for program, name in zip(PROGRAMS, written, strict=True):
        assert f'#include "{name}"' in program
