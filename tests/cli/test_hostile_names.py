"""Names that would steer a terminal, or break XML, are printed and written with escapes."""

import ast
import shutil
import unicodedata
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import butterfly as bf
import butterfly.cli
from butterfly.errors import visible

HOSTILE = "a\x1b]0;t\x07\x1b[31m\x9b1m\x7f\x08\u202eb"


def raw(text):
    """Characters of a text that a terminal obeys or hides."""
    return {each for each in text if unicodedata.category(each)[0] == "C"} - {"\n"}


@pytest.fixture(scope="module")
def hostile(quick_data, tmp_path_factory):
    """Logs whose folder, data set and files are named by somebody who means harm."""
    folder = tmp_path_factory.mktemp("names") / HOSTILE
    shutil.copytree(quick_data, folder)
    content = yaml.safe_load((folder / "manifest.yaml").read_text())
    content |= {"name": HOSTILE, "description": HOSTILE, "root": str(folder)}
    content["logs"] = content["logs"][::2]
    for number, entry in enumerate(content["logs"]):
        name = f"{HOSTILE}{number}{Path(entry['file']).suffix}"
        (folder / entry["file"]).rename(folder / name)
        entry["file"] = name
    (folder / "manifest.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return folder


@settings(max_examples=50)
@given(st.text())
def test_what_is_visible_is_what_was_said_without_what_steers(text):
    shown = visible(text)
    assert raw(shown) <= {"\t"}
    if text.isascii() and text.isprintable():
        assert shown == text


@pytest.mark.usefixtures("brief_twins")
def test_no_command_prints_a_name_raw_or_writes_it_into_xml(butterfly, hostile, tmp_path):
    saved, forms = tmp_path / f"{HOSTILE}.json", ("twin.xml", "twin.urdf", "lines.xml")
    calls = [
        ("inspect", hostile, "--verbose"),
        ("identify", hostile, "--method", "weak-form", "--terms", "", "--save", saved, "--verbose"),
        ("identify", hostile, "--method", "weak-form", "--terms", "", "--json", "-"),
        ("inspect", saved),
        ("residual", saved, "--report", tmp_path / "r.html", "--figures"),
        ("export", saved, "--out", tmp_path / forms[0]),
        ("export", saved, "--to", "urdf", "--out", tmp_path / forms[1]),
        ("export", saved, "--to", "snippet", "--out", tmp_path / forms[2]),
        ("inspect", hostile / "missing\x1b[2J.csv"),
        ("inspect", hostile, "--units", "\x1b[2J=deg"),
        (f"\x1b[2J{HOSTILE}",),
        ("show", f"\x1b[2J{HOSTILE}"),
    ]
    for call in calls:
        code, out, err = butterfly(*call)
        assert raw(out + err) == set(), call
        assert (code in {0, 3}) == (call in calls[:8]), (call, err)
    assert HOSTILE[-1] in (tmp_path / forms[0]).read_text(encoding="utf-8")
    for name in forms:
        text = (tmp_path / name).read_text(encoding="utf-8")
        assert raw(text) == set(), name
        ElementTree.fromstring(f"<all>{text[text.find('?>') + 2 * ('?>' in text) :]}</all>")  # noqa: S314
    pictures = [*(tmp_path / "r-figures").glob("*.svg")]
    assert pictures
    for picture in pictures:
        ElementTree.parse(picture)  # noqa: S314 - our own


def test_no_result_says_a_name_raw(hostile):
    found = bf.identify(hostile, "weak-form", terms=())
    for each in (found, bf.inspect(hostile), bf.read(hostile), bf.read(hostile).logs[0]):
        assert raw(f"{each}{each!r}") == set()


def test_commands_print_by_one_function():
    folder = Path(butterfly.cli.__file__).parent
    for path in folder.glob("*.py"):
        calls = [
            node
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "print"
        ]
        allowed = {"output.py": 4, "app.py": 1}.get(path.name, 0)  # put, JSON, styled; an error
        assert len(calls) <= allowed, path.name
