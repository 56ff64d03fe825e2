"""MuJoCo models of all the robots that an identification leaves open, for domain randomisation."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.plant.mjcf import mjcf
from butterfly.plant.twin import twin


def models(
    drawn: Iterable[LumpedParameters],
    added: AddedMass = NO_ADDED_MASS,
    *,
    mass: float | None = None,
    bristle_stiffness: float = 0.0,
) -> Iterator[str]:
    """Yield the MJCF text of a robot for each set of parameters, which loads in plain MuJoCo.

    The input delay is left out (`butterfly.plant.stand_alone` has it).

    Parameters
    ----------
    drawn
        Parameters of the bare hand; numbers of any kind, as frames have them.
    added
        What it carries.
    mass
        Of the hand in kg; see `butterfly.plant.twin.twin`.
    bristle_stiffness
        In N m/rad, of friction that is larger at rest, which these models have with bristles only
        (`butterfly.plant.stand_alone` has it without).

    Raises
    ------
    InputError
        If no hand of that mass moves so, or such friction has no bristles.
    """
    for parameters in drawn:
        bends = bristle_stiffness if parameters.stribeck > 0 else 0.0
        bent = replace(parameters, bristle_stiffness=bends) if bends else parameters
        yield mjcf(twin(bent, mass), added)
