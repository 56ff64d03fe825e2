"""MuJoCo models of all the robots that an identification leaves open, for domain randomisation."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from butterfly.model.parameters import NO_ADDED_MASS, LumpedParameters
from butterfly.plant.mjcf import mjcf
from butterfly.plant.twin import MASS, twin

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from butterfly.model.parameters import AddedMass


def models(
    drawn: Iterable[LumpedParameters],
    added: AddedMass = NO_ADDED_MASS,
    *,
    mass: float = MASS,
    bristle_stiffness: float = 0.0,
) -> Iterator[str]:
    """Yield the MJCF text of a robot for each set of parameters, which loads in plain MuJoCo.

    The input delay is left out, as of any such model (see `butterfly.plant.twin.twin`).

    Parameters
    ----------
    drawn
        Parameters of the bare hand; numbers of any kind, as frames have them.
    added
        What it carries.
    mass
        Of the hand in kg; the motion does not tell it.
    bristle_stiffness
        In N m/rad, of friction that is larger at rest: MuJoCo has it with bristles only.

    Raises
    ------
    InputError
        If no hand of that mass moves so, or such friction has no bristles.
    """
    for parameters in drawn:
        plain = LumpedParameters(**{key: float(value) for key, value in vars(parameters).items()})
        if plain.stribeck > 0 and bristle_stiffness:
            plain = replace(plain, bristle_stiffness=bristle_stiffness)
        yield mjcf(twin(plain, mass), added)
