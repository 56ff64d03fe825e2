from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from butterfly.files import shipped
from butterfly.model.parameters import AddedMass
from butterfly.plant.looks import disc_radius, dress, undress


def _shipped():
    return ElementTree.parse(shipped("models/butterfly_hand/hand.xml")).getroot()  # noqa: S314 - our own


def test_the_disc_has_the_volume_of_brass_of_the_added_mass():
    radius = disc_radius(0.154)
    assert 8500 * np.pi * radius**2 * (radius / 2) == pytest.approx(0.154)


def test_the_disc_is_drawn_where_and_as_large_as_the_added_mass_is():
    root = _shipped()
    dress(root, AddedMass(mass=0.154, arm=0.104))
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
    disc = model.geom("added_mass")
    assert disc.size[0] == disc_radius(0.154)
    assert model.body(disc.bodyid[0]).name == "added_mass"
    assert (disc.pos[0], disc.pos[2]) == (0, 0)


def test_even_the_smallest_added_mass_is_seen():
    assert disc_radius(1e-12) == 0.004


def test_nothing_is_drawn_of_no_added_mass():
    root = _shipped()
    dress(root, AddedMass())
    assert ElementTree.tostring(root) == ElementTree.tostring(_shipped())


def test_an_undressed_robot_has_nothing_to_draw():
    root = _shipped()
    undress(root)
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
    assert (model.ngeom, model.nmesh, model.nbody, model.nu) == (0, 0, 3, 1)
