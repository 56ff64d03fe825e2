import json
import pickle
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Literal

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import Field

from butterfly.errors import InputError
from butterfly.files import shipped, shipped_experiments
from butterfly.yaml_files import StrictModel, load_yaml, validate, yaml_text


def _read(folder, text, errors="strict"):
    path = folder / "a.yaml"
    path.write_text(text, encoding="utf-8", errors=errors)
    return load_yaml(path)


TYPED = {"1e-4": 1e-4, "2.0e-4": 2e-4, "+1E3": 1e3, "-.5": -0.5, "0o14": 12, "014": 14}
TYPED |= {"0x1F": 31, "true": True, "~": None, "'1e-4'": "1e-4"}
TYPED |= {text: text for text in ("1:30", "yes", "2026-11-21", "=")}
TYPED |= {"[1e-4, {b: 2e5}]": [1e-4, {"b": 2e5}]}


@pytest.mark.parametrize(("text", "value"), TYPED.items())
def test_a_value_is_what_yaml_1_2_says(tmp_path, text, value):
    content = _read(tmp_path, f"a: {text}\n").content
    assert content == {"a": value}
    assert type(content["a"]) is type(value)


@pytest.mark.parametrize("name", shipped_experiments())
def test_a_shipped_file_holds_plain_values_the_same_as_for_another_reader(name):
    content = load_yaml(shipped(name)).content

    def check(value):
        assert type(value) in {dict, list, str, float, int, bool, type(None)}
        if isinstance(value, dict):
            value = list(value.values())
        if isinstance(value, list):
            for below in value:
                check(below)

    check(content)
    assert content == yaml.safe_load(shipped(name).read_text())
    assert json.loads(json.dumps(content)) == pickle.loads(pickle.dumps(content)) == content  # noqa: S301 - our own


LAUGHS = "a0: &a0 [1]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 20)}]\n" for k in range(1, 30)
)
DEEP = "a0: &a0 [1]\n" + "".join(f"a{k}: &a{k} [*a{k - 1}]\n" for k in range(1, 90))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: 2\na: 3", "3: a: got the same key twice; expected one value"),
        ("a:\n  - {b: 1, b: 2}", "2: b: got the same key twice"),
        ("<<: {a: 1}\n<<: {b: 1}", "2: <<: got the same key twice"),
        ("a: 1\nb: [1", " line 2: got"),
        ("a: 1\nb: *c", " line 2: got found undefined alias"),
        ("a: 1\n---\nb: 1", " line 2: got but found another document"),
        ("a: !!python/object/apply:os.system [ls]", " line 1: got could not determine"),
        ("a: !!set {b}", " line 1: got could not determine"),
        ("a: !!bool 3", " line 1: got 3, not a valid bool"),
        ("b: 1\na: !!int ''", " line 2: got , not a valid int"),
        ("b: 1\n\na: -_", " line 3: got -_, not a valid int"),
        ("b: 1\n3: 1", " line 2: got a key that is not text"),
        ("b: 1\na: &a {b: *a}", " line 2: got an alias that contains itself"),
        (LAUGHS, " line 5: got more than 300,000 values, with aliases expanded"),
        (DEEP, " line 51: got aliases nested more than 50 deep"),
        ("# " + "x" * 2_000_000, " content: got 2.0 MB; expected an existing YAML file of at most"),
        ("a: \x01", " content: got unreadable text"),
        ("a: " + 400 * "[" + 400 * "]", " line 1: got mappings and lists nested more than 50 deep"),
        ("? {b: 1}\n: 1", " line 1: got found unhashable key"),
        ("", " content: got NoneType; expected a mapping"),
    ],
)
def test_what_cannot_be_read_is_one_error_with_its_line(tmp_path, text, message):
    with pytest.raises(InputError) as caught:
        _read(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path}/a.yaml:{message}")


def test_bytes_that_are_no_text_are_named(tmp_path):
    (tmp_path / "latin.yaml").write_bytes("é: 1".encode("latin-1"))
    with pytest.raises(InputError, match="bytes that are not text"):
        load_yaml(tmp_path / "latin.yaml")


@settings(max_examples=50)
@given(st.text())
def test_any_text_is_a_mapping_or_one_error(tmp_path, text):
    with suppress(InputError):
        assert isinstance(_read(tmp_path, text, "surrogatepass").content, dict)


def test_a_merged_mapping_gives_its_values_and_lines(tmp_path):
    document = _read(tmp_path, "a: &base\n  b: 1\n  c: 2\nd:\n  <<: *base\n  c: 3\n")
    assert document.content["d"] == {"b": 1, "c": 3}
    assert document.line(["d", "b"]) == 2
    assert document.line(["d", "c"]) == 6


NUMBERS = st.booleans() | st.integers() | st.floats(allow_nan=False)
VALUES = st.recursive(
    st.none() | NUMBERS | st.text("ab1e-.: '") | st.text(),
    lambda below: st.lists(below, max_size=3) | st.dictionaries(st.text("ab1."), below, max_size=3),
    max_leaves=6,
)


@given(content=st.dictionaries(st.text('abn1-. :"{#&'), VALUES, max_size=4), flow=st.booleans())
@example(content={"": ": 1"}, flow=True)
@example(content={"": [": '"]}, flow=True)
@example(content={"a\n": " \u2028#", "yes": "no", "- a": "1e3"}, flow=True)
def test_written_values_read_back_the_same_in_their_order(tmp_path, content, flow):
    read = _read(tmp_path, yaml_text(content, flow=flow)).content
    assert read == content
    assert list(read) == list(content)


@given(st.floats(allow_nan=False))
def test_a_written_number_is_a_number_to_readers_of_yaml_1_1_too(value):
    assert yaml.safe_load(yaml_text({"a": value})) == {"a": value}


@dataclass(frozen=True, kw_only=True)
class Square:
    kind: Literal["square"] = "square"
    side: float

    def __post_init__(self):
        if self.side == 13:
            raise InputError("square", "side", self.side, "a lucky number")


class Circle(StrictModel):
    kind: Literal["circle"] = "circle"
    radius: float
    name: str = ""


class Drawing(StrictModel):
    shapes: list[Annotated[Square | Circle, Field(discriminator="kind")]]
    scale: float | list[float] = 1.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("shapes: [{kind: circle, radius: big}]", "1: shapes.0.radius: got 'big'"),
        ("shapes:\n- {kind: circle, radius: -}", "2: shapes.0.radius: got '-'"),
        ("shapes: [{kind: circle}]", "1: shapes.0.radius: got nothing"),
        ("shapes: [{kind: square, side: 13}]", "1: shapes.0.side: got 13.0; expected a luck"),
        ("shapes: [{kind: triangle}]", "1: shapes.0: got {'kind': 'triangle'}"),
        ("shapes: [{kind: circle, nam: x}]", "1: shapes.0.nam: got an unknown key; expected"),
        (
            "shapes: [{kind: square, sid: 1}]",
            "1: shapes.0.sid: got an unknown key; expected 'side'",
        ),
        ("shapes: []\nscale: [1, two]", "2: scale: got [1, 'two']"),
    ],
)
def test_a_field_reads_as_the_document_has_it_without_the_kinds_of_unions(tmp_path, text, message):
    document = _read(tmp_path, text)
    with pytest.raises(InputError) as caught:
        validate([document], document.content, Drawing)
    assert str(caught.value).startswith(f"{tmp_path}/a.yaml:{message}")
