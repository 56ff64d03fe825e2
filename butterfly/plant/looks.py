"""What a robot looks like: none of it has mass or contact of its own."""

from __future__ import annotations

import math
from xml.etree import ElementTree

from butterfly.model.parameters import AddedMass

_PLATE = 0.15  # m from the axis to the end of a plate
_SCENE = 0.2  # m from the axis that the camera shows at least
_BRASS = 8500.0  # kg/m³
_FLATNESS = 0.5  # thickness of the disc over its radius
_SMALLEST = 0.004  # m, a disc that can be seen
_BOLT = 0.28  # radius of the disc's bolt over its own
_FRONT = -0.0145  # m along the axis, where the painted front plate ends
_ROD = 0.004  # m, radius


def disc_radius(mass: float) -> float:
    """Return the radius in m of the disc that is drawn for an added mass in kg: of brass."""
    return max(_SMALLEST, math.cbrt(mass / (math.pi * _FLATNESS * _BRASS)))


def dress(root: ElementTree.Element, added: AddedMass) -> None:
    """Draw the added mass: a disc of its size, screwed to the front plate or to a rod beyond it.

    Cameras step back to what is beyond the plate.

    Parameters
    ----------
    root
        Of the robot's MJCF, with its scene if there is one; changed.
    added
        What the robot carries; nothing is drawn of no mass.
    """
    if not added.mass:
        return
    body = next(each for each in root.iter("body") if each.get("name") == "added_mass")
    radius = disc_radius(added.mass)
    half, bolt = _FLATNESS * radius / 2, _BOLT * radius
    depth = _FRONT - half
    _geom(body, "brass", name="added_mass", size=(radius, half), pos=(0, depth, 0))
    _geom(body, "dark", size=(bolt, bolt / 4), pos=(0, depth - half - bolt / 4, 0))
    reach = added.arm + radius
    if reach > _PLATE:
        ends = (0, depth, 0, 0, depth, added.arm)
        _geom(body, "visual", type="capsule", size=(_ROD,), fromto=ends)
    if reach > _SCENE:
        _step_back(root, reach / _SCENE)


def undress(root: ElementTree.Element) -> None:
    """Leave out all that is drawn, which would cost time wherever nobody looks."""
    for parent in root.iter():
        for child in [each for each in parent if each.tag in {"geom", "asset"}]:
            parent.remove(child)


def _geom(body: ElementTree.Element, kind: str, **attributes: str | tuple[float, ...]) -> None:
    texts = {
        name: value if isinstance(value, str) else " ".join(map(repr, value))
        for name, value in attributes.items()
    }
    ElementTree.SubElement(body, "geom", {"class": kind} | texts)


def _step_back(root: ElementTree.Element, factor: float) -> None:
    for tag, name in (("camera", "pos"), ("statistic", "extent")):
        for element in root.iter(tag):
            numbers = [factor * float(number) for number in element.get(name, "").split()]
            element.set(name, " ".join(map(repr, numbers)))
