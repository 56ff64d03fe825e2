"""XML is found and changed where it is written."""

import os
import re
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.twin.xml_text import XmlText, changed, inserted, spliced

NAMES = ("name", "armature", "class", "damping", "θ", "a.b-c")
spaces = st.text(" \t\n", min_size=1, max_size=3)
values = st.text(st.sampled_from("01.- ae&<>\"'\t\n手é😀/="), max_size=8)
comments = st.sampled_from(
    ["", " ", "<!-- <t name='x' damping='1'> -->", "<?t name='x'?>", "<u>/></u>"]
)


def escaped(value, quote):
    """A value as somebody could write it."""
    plain = value.replace("&", "&amp;").replace("<", "&#60;").replace(quote, f"&#{ord(quote)};")
    return quote + plain.replace("\n", "&#xA;").replace("\t", "&#9;") + quote


@st.composite
def start_tags(draw):
    """The text of a start tag without its end, and its attributes."""
    attributes = draw(st.dictionaries(st.sampled_from(NAMES), values))
    text = "<t"
    for name, value in attributes.items():
        equals = draw(st.sampled_from(["=", " = ", "=\n", "\t="]))
        text += draw(spaces) + name + equals + escaped(value, draw(st.sampled_from("\"'")))
    return text + draw(st.sampled_from(["", " ", "\n"])), attributes


def read(folder, content):
    path = folder / f"{os.urandom(4).hex()}.xml"
    path.write_bytes(content)
    return XmlText.of(path, "a file", including="mujoco")


def edited(text, element, attributes):
    source = text.sources[element.file]
    changes, splices = changed(source, element, attributes)
    return changes, spliced(source.content, splices)


@given(
    tag=start_tags(),
    edits=st.dictionaries(st.sampled_from(NAMES), st.none() | values),
    around=st.tuples(comments, st.sampled_from(["/>", "></t>"]), comments),
    way=st.tuples(
        st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]), st.sampled_from(["\n", "\r\n"])
    ),
)
def test_a_start_tag_gets_the_attributes_and_all_around_it_stays(tmp_path, tag, edits, around, way):
    (start, attributes), (encoding, line_end) = tag, way
    before, after = f"<root>{around[0]}", f"{around[1]}{around[2]}</root>"
    before, start, after = (part.replace("\n", line_end) for part in (before, start, after))
    text = read(tmp_path, f"{before}{start}{after}".encode(encoding))
    (element,) = (one for one in text.elements if one.tag == "t")
    assert element.attributes == attributes
    changes, content = edited(text, element, edits)
    result = content.decode(encoding)
    assert content == result.encode(encoding)
    assert result.startswith(before)
    assert result.endswith(after)
    wanted = {name: value for name, value in (attributes | edits).items() if value is not None}
    found = ElementTree.fromstring(content).find("t")  # noqa: S314 - our own text
    assert found.attrib == wanted
    assert {change.attribute for change in changes} == {
        name for name in edits if edits[name] != attributes.get(name)
    }
    for change in changes:
        assert (change.before, change.after) == (
            attributes.get(change.attribute),
            edits[change.attribute],
        )
    order = [name for name in attributes if name in wanted]
    assert list(found.attrib)[: len(order)] == order
    untouched = [name for name in attributes if name not in edits]
    for name in untouched:
        written = re.search(rf"\s{re.escape(name)}\s*=\s*(\"[^\"]*\"|'[^']*')", start)
        assert written[0] in result


def test_letters_that_the_encoding_lacks_become_references(tmp_path):
    content = '<?xml version="1.0" encoding="cp1252"?><a>€<b c="€"/></a>'.encode("cp1252")
    text = read(tmp_path, content)
    _, after = edited(text, text.elements[1], {"c": "θ€", "d": "1"})
    assert after == content.replace(b'c="\x80"', b'c="&#952;\x80" d="1"')


def test_a_new_child_is_the_last_and_indented_as_the_first(tmp_path):
    cases = {
        "<a>\r\n\t<b/>\r\n\r\n</a>": '<a>\r\n\t<b/>\r\n\t<n c="1"/>\r\n\r\n</a>',
        "<a><b/></a>": '<a><b/><n c="1"/></a>',
        "<a></a>": '<a><n c="1"/></a>',
        "<a x='/>'>\n\n  <!--/> --> </a>": "<a x='/>'>\n\n  <!--/> -->\n  <n c=\"1\"/> </a>",
    }
    for before, after in cases.items():
        text = read(tmp_path, before.encode())
        (source,) = text.sources.values()
        changes, splices = inserted(source, text.elements[0], "n", {"c": "1"})
        assert spliced(source.content, splices).decode() == after
        assert [change[1:] for change in changes] == [("c", None, "1")]


def test_values_that_a_document_type_supplies_are_not_written(tmp_path):
    content = b'<!DOCTYPE a [<!ATTLIST a b CDATA "1">]><a c="2"/>'
    text = read(tmp_path, content)
    assert edited(text, text.elements[0], {"b": None}) == ([], content)


def test_elements_of_an_included_file_come_in_its_place(tmp_path):
    (tmp_path / "b.xml").write_text("<x>\n<c/><d/></x>")
    text = read(tmp_path, b'<mujoco><a><include file="b.xml"/></a><e/></mujoco>')
    assert [one.tag for one in text.elements] == ["mujoco", "a", "include", "c", "d", "e"]
    inner = text.elements[3]
    assert [one.tag for one in inner.above] == ["a", "mujoco"]
    assert text.place(inner) == "b.xml line 2"
    assert list(text.sources) == [text.path, tmp_path / "b.xml"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"<a>\n<b></a>", "line 2: got mismatched tag; expected well-formed XML"),
        (b"", "line 1: got no element found; expected well-formed XML"),
        (b"<a b='1' b='2'/>", "line 1: got duplicate attribute"),
        (b'<?xml version="1.0" encoding="shift_jis"?><a/>', "got shift_jis; expected UTF-8"),
        (b'<?xml version="1.0" encoding="nope"?><a/>', "encoding: got nope; expected UTF-8"),
        (b"<!DOCTYPE a [\n<!ENTITY x 'y'>]><a/>", "line 2: got <!ENTITY; expected a file that"),
        (b"<mujoco>\n<include/></mujoco>", "line 2: got <include> without a file"),
        (b"<mujoco><include file='no.xml'/></mujoco>", "no.xml: path: got no such file; expected"),
        (b"<mujoco><include file='main.xml'/></mujoco>", "got main.xml, a second time"),
        (b"<mujoco><include file='a.xml'/></mujoco>", "a.xml: line 1: got ./a.xml, a second time"),
        (b"<mujoco><include file='c.xml'/>\n<include file='./c.xml'/></mujoco>", "line 2: got ./c"),
        (b"<mujoco><include file='bad.xml'/></mujoco>", "bad.xml: line 3: got mismatched tag"),
    ],
)
def test_what_cannot_be_read_is_refused(tmp_path, content, message):
    (tmp_path / "a.xml").write_text("<x><include file='./a.xml'/></x>")
    (tmp_path / "c.xml").write_text("<x/>")
    (tmp_path / "bad.xml").write_text("<x>\n\n</y>")
    path = tmp_path / "main.xml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=re.escape(message)):
        XmlText.of(path, "a file", including="mujoco")


def test_includes_are_followed_in_mjcf_alone(tmp_path):
    text = read(tmp_path, b"<robot><include file='no.xml'/></robot>")
    assert len(text.sources) == 1
