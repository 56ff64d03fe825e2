"""The text of somebody's robot, MJCF or URDF: some attributes change, and nothing else does.

Attributes are set at the element itself, whatever its defaults say.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from butterfly import outputs
from butterfly.errors import InputError, nearest
from butterfly.files import write_file
from butterfly.twin.xml_text import (
    AttributeChange,
    Splice,
    XmlElement,
    XmlSource,
    XmlText,
    changed,
    inserted,
    is_same,
    spliced,
)

ACTUATOR = "actuator"
"""The tag of an `Edit` of any actuator of MJCF, whichever its own tag is."""

DYNAMICS = "dynamics"
"""The tag of an `Edit` of the ``dynamics`` of a joint of URDF, inserted if there are none."""

_MJCF, _URDF, _JOINT = "mujoco", "robot", "joint"
_MAKERS = ("attach", "replicate")  # of MJCF: what they make has other names, and no text
_FOLDERS = ("meshdir", "texturedir", "assetdir")  # of MJCF's compiler


class Edit(NamedTuple):
    """Attributes of the element of a tag and name, as they shall be; None removes one.

    The tag is ``joint``, that of an actuator, `ACTUATOR`, or `DYNAMICS` with the joint's name. An
    actuator without a name is found ``by`` its joint's.
    """

    tag: str
    name: str
    attributes: Mapping[str, str | None]
    by: Literal["name", "joint"] = "name"


class TextChange(NamedTuple):
    """An attribute that is set, replaced or removed; the line is that in the file as it is."""

    file: Path
    line: int
    element: str
    attribute: str
    before: str | None
    after: str | None


@dataclass(frozen=True, kw_only=True, eq=False)
class EditedText:
    """A robot in which attributes are changed.

    Parameters
    ----------
    original
        The robot's files as they are.
    contents
        Each of its files with the changes, by its path in the original, the main one first.
    changes
        What changes.
    """

    original: XmlText
    contents: Mapping[Path, bytes]
    changes: tuple[TextChange, ...]

    def write(self, out: Path, *, overwrite: bool = False) -> tuple[str, ...]:
        """Write the main file to a path, and what it includes beside it.

        In the original's folder only the main file is written. In another one included files keep
        their places relative to it, except those that are included by an absolute path.

        Parameters
        ----------
        out
            The path.
        overwrite
            Whether existing files may be replaced. The original's never are.

        Returns
        -------
        tuple of str
            The meshes, textures and other files that are not found from the new place.

        Raises
        ------
        InputError
            A file would be written over one of the original's or, unless ``overwrite``, over any
            other; or an included file that changes has no place of its own.
        """
        outputs.require_endings(out, (self.original.path.suffix.lower(),))
        with outputs.call(overwrite=overwrite):
            for path in self.original.sources:
                outputs.note_input(path)
            outputs.require_free(out)
            targets = self._targets(out)
            for target in targets:
                outputs.require_free(target)
            for target, content in targets.items():
                write_file(target, content)
        return _not_found(self.original, out.parent)

    def _targets(self, out: Path) -> dict[Path, bytes]:
        """Return what is written where, the main file last."""
        original, targets = self.original, dict[Path, bytes]()
        for path, content in list(self.contents.items())[1:]:
            absolute = path in original.absolute
            place = str(path) if absolute else os.path.relpath(path, original.path.parent)
            outside = absolute or ".." in Path(place).parts
            target = path if absolute else Path(os.path.normpath(out.parent / place))
            if is_same(target, path):
                if content != original.sources[path].content:
                    expected = f"another folder: the included {place} changes, too"
                    if outside:
                        expected = f"a robot that includes {place}, which changes, from its folder"
                    raise InputError(out, "path", "a place that shares a file", expected)
                continue
            if outside:
                expected = f"a folder from which {place} is found, which is included"
                raise InputError(out, "path", f"a file in {out.parent}", expected)
            if target == Path(os.path.normpath(out)):
                raise InputError(out, "path", "the name of an included file", "another name")
            if not (target.is_file() and target.read_bytes() == content):
                targets[target] = content
        return targets | {out: self.contents[original.path]}


def with_attributes(path: Path, edits: Iterable[Edit]) -> EditedText:
    """Return a robot's MJCF or URDF with all edits; of two of one attribute the later counts.

    Raises
    ------
    InputError
        A file is missing, included twice or no well-formed XML; an element is not there, is there
        twice, or has no text of its own.
    """
    text = XmlText.of(path, "an MJCF or URDF file", including=_MJCF)
    root = text.elements[0].tag
    if root not in {_MJCF, _URDF}:
        raise InputError(path, "content", f"<{root}>", "MJCF (<mujoco>) or URDF (<robot>)")
    wanted: dict[tuple[XmlElement, str, str], dict[str, str | None]] = {}
    for edit in edits:
        element, title, new = *_element(text, edit), ""
        if edit.tag == DYNAMICS:
            title, new = f"{DYNAMICS} of {title}", DYNAMICS
            if there := [child for child in element.children if child.tag == DYNAMICS]:
                element, new = _only(text, there, DYNAMICS, edit.name), ""
        wanted.setdefault((element, title, new), {}).update(edit.attributes)
    splices: dict[Path, list[Splice]] = {file: [] for file in text.sources}
    changes: list[TextChange] = []
    for (element, title, new), attributes in wanted.items():
        source = text.sources[element.file]
        more, replaced = _changes(source, element, new, attributes)
        splices[element.file] += replaced
        changes += (
            TextChange(source.path, one.line, title, one.attribute, one.before, one.after)
            for one in more
        )
    contents = {file: spliced(text.sources[file].content, splices[file]) for file in splices}
    return EditedText(original=text, contents=contents, changes=tuple(changes))


def _changes(
    source: XmlSource, element: XmlElement, new: str, attributes: Mapping[str, str | None]
) -> tuple[list[AttributeChange], list[Splice]]:
    """Return what changes in an element, or by a new child of it."""
    if not new:
        return changed(source, element, attributes)
    present = {name: value for name, value in attributes.items() if value is not None}
    return inserted(source, element, new, present) if present else ([], [])


def _element(text: XmlText, edit: Edit) -> tuple[XmlElement, str]:
    """Return the element that an edit means, of `DYNAMICS` the joint, and what to call it."""
    tag, name, _, by = edit
    is_urdf = text.elements[0].tag == _URDF
    if is_urdf != (tag == DYNAMICS) and tag != _JOINT:
        expected = f"joint or {DYNAMICS} in URDF" if is_urdf else "joint or an actuator in MJCF"
        raise InputError(text.path, "tag", tag, expected)
    valid = [one for one in text.elements if by in one.attributes and _is(one, tag, is_urdf)]
    alike = [one for one in valid if one.attributes[by] == name]
    kind = _JOINT if tag == DYNAMICS else tag
    if not alike:
        names = dict.fromkeys(one.attributes[by] for one in valid)
        expected = nearest(name, names) if names else f"{kind}s with a {by}; there are none"
        raise InputError(text.path, kind, name, f"{expected}{_elsewhere(text)}")
    element = _only(text, alike, kind, name)
    if maker := next((one for one in element.above if one.tag in _MAKERS), None):
        value = f"{name}, which <{maker.tag}> of {text.place(maker)} makes"
        raise InputError(text.path, kind, value, f"a {kind} with a text of its own")
    named = element.attributes.get("name")
    return element, f"{element.tag} {named!r}" if named else f"{element.tag} of joint {name!r}"


def _elsewhere(text: XmlText) -> str:
    """Say where elements come from that are not written in the text."""
    files = [
        file for one in text.elements if one.tag == "model" and (file := one.attributes.get("file"))
    ]
    if files:
        return f" (<attach> takes more from {' and '.join(files)}: change it there)"
    makers = sorted({f"<{one.tag}>" for one in text.elements if one.tag in _MAKERS})
    return f" (what {' and '.join(makers)} makes has no text of its own)" if makers else ""


def _is(element: XmlElement, tag: str, is_urdf: bool) -> bool:
    """Whether an element is one that the tag of an edit means."""
    tags = [one.tag for one in element.above]
    if is_urdf:
        return element.tag == _JOINT and tags == [_URDF]
    if tag == _JOINT:
        return element.tag == _JOINT and "worldbody" in tags
    return tags == [ACTUATOR, _MJCF] and tag in {ACTUATOR, element.tag}


def _only(text: XmlText, elements: Sequence[XmlElement], tag: str, name: str) -> XmlElement:
    """Return the one element that there is of a tag and name."""
    if len(elements) > 1:
        places = " and ".join(map(text.place, elements))
        raise InputError(text.path, tag, f"{name} {len(elements)} times ({places})", "only one")
    return elements[0]


def _not_found(text: XmlText, folder: Path) -> tuple[str, ...]:
    """Name the files that the text mentions and that are not found from a folder, as they are."""
    compilers = [one.attributes for one in text.elements if one.tag == "compiler"]
    folders = {"", *(one[key] for one in compilers for key in _FOLDERS if key in one)}
    names = {
        value
        for one in text.elements
        for key, value in one.attributes.items()
        if key.startswith("file") and one.tag != "include"  # file, fileup, filename, ...
    }
    paths = {
        Path(base, part) for base in folders for name in names for part in (name, Path(name).name)
    }
    there = (path for path in paths if (text.path.parent / path).is_file())
    return tuple(sorted(str(path) for path in there if not (folder / path).is_file()))
