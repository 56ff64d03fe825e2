"""Whether the added masses that were told agree with each other."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from butterfly.errors import InputError
from butterfly.model.parameters import AddedMass, rounded

Samples = NDArray[np.float64]

_OF_A_LOG = 25.0  # F statistic above which a log's correction is no fluke, though one of many
_MISTAKEN = 12.0  # of a log that may have carried another of the masses
_NEAR = 2.0  # standard errors from that mass
_OF_A_MASS = 40.0  # of a whole mass, which takes up some of what the model lacks
_MATTERS = 0.05  # of the largest mass, below which a correction does not matter
_EXACT = 1e-12  # of what a correction explains, that rounding leaves
_LEAST_MASSES = 3  # of which one can be wrong: to call two the same explains everything
_UNSEEN = 1e-8  # share of a column that the parameters leave, below which it is one of them


@dataclass(frozen=True, kw_only=True)
class Correction:
    """What some logs would have carried, had the rest been told right."""

    told: AddedMass  # what they are said to have carried
    logs: tuple[int, ...]  # their numbers
    change: float  # to be added to the told mass, in kg
    evidence: float  # F statistic of the change: that of one more parameter
    mistaken: bool = False  # whether the corrected mass may be another of those that were told

    @property
    def evident(self) -> bool:
        """Whether it is no fluke."""
        if len(self.logs) > 1:
            return self.evidence > _OF_A_MASS
        return self.evidence > (_MISTAKEN if self.mistaken else _OF_A_LOG)


def corrections(
    rows: Samples,
    residuals: Samples,
    names: Sequence[str],
    carried: Mapping[int, AddedMass],
) -> tuple[Correction, ...]:
    """Return what each added mass, and each log alone, would have to be; the best explained first.

    A mass that is off by dm adds dm (l^2 r_1 + g l r_3) to the residuals of its logs, r_1 and r_3
    being their derivatives by p1 and p3. The change that explains most of the (k, m) residuals,
    once the parameters follow by the (k, m, n) rows, is a regression on one column more. Without p1
    and p3, or what was carried by number of the log, there is nothing to tell.
    """
    if not carried or not {"p1", "p3"} <= set(names):
        return ()
    inertia, gravity = (rows[:, :, names.index(name)] for name in ("p1", "p3"))
    masses, numbers = list(carried.values()), np.array(list(carried))
    farthest = max(mass.arm for mass in masses)  # where a bare hand would carry what it was not to
    arms = np.array([[mass.arm or farthest] for mass in masses])
    columns = arms**2 * inertia + masses[0].gravity * arms * gravity
    flat = rows.reshape(-1, len(names))
    size = np.linalg.norm(flat, axis=0)
    basis = np.linalg.qr(flat / np.where(size > 0, size, 1.0))[0]
    rest = residuals.ravel() - basis @ (basis.T @ residuals.ravel())
    freedom = int(np.count_nonzero(np.any(rows != 0, axis=2))) - len(names) - 1
    if freedom < 1:
        return ()
    found = []
    for mass, logs in _suspects(masses):
        column = np.zeros_like(columns)
        column[list(logs)] = columns[list(logs)]
        own = column.ravel() - basis @ (basis.T @ column.ravel())
        length = float(own @ own)
        if not length > _UNSEEN * float(np.sum(column**2)):
            continue
        change = -float(own @ rest) / length
        explained = change**2 * length
        left = max(float(rest @ rest) - explained, _EXACT * explained)
        evidence = explained * freedom / left if left else 0.0
        whose = tuple(numbers[list(logs)].tolist())
        reach = _NEAR * abs(change) / math.sqrt(max(evidence, _EXACT))
        mistaken = any(
            abs(mass.mass + change - other.mass) < reach for other in masses if other != mass
        )
        found.append(
            Correction(told=mass, logs=whose, change=change, evidence=evidence, mistaken=mistaken)
        )
    return tuple(sorted(found, key=lambda each: -each.evidence))


def disagreeing(found: Sequence[Correction], masses: Sequence[AddedMass]) -> list[Correction]:
    """Return the corrections that are no fluke and matter: the masses do not agree without one."""
    largest = max(mass.mass for mass in masses)
    return [each for each in found if each.evident and abs(each.change) > _MATTERS * largest]


def _suspects(masses: Sequence[AddedMass]) -> list[tuple[AddedMass, tuple[int, ...]]]:
    """Return the logs of each added mass, and each log that is not the only one of its mass.

    Of two masses none can be judged: to call both the same explains everything.
    """
    own: dict[AddedMass, list[int]] = {}
    for number, mass in enumerate(masses):
        own.setdefault(mass, []).append(number)
    single = [(masses[k], (k,)) for group in own.values() if len(group) > 1 for k in group]
    enough = len({mass.inertia_and_moment for mass in own}) >= _LEAST_MASSES
    whole = [(mass, tuple(group)) for mass, group in own.items()] if enough else []
    return [*whole, *single]


def moved_by_masses(
    rows: Samples, names: Sequence[str], carried: Mapping[int, AddedMass]
) -> Samples | None:
    """Return what uncertain added masses, and their arms, do to the residuals of the logs.

    A mass that is off by dm adds dm (l^2 r_1 + g l r_3) to the residuals of its logs, an arm that
    is off by dl adds dl m (2 l r_1 + g r_3), with r_1 and r_3 their derivatives by p1 and p3. Equal
    masses are taken to be the same piece of metal, equal arms the same hole.

    Of (k, m, n) rows it is (k, m, q) for q uncertain quantities, each times its standard
    uncertainty; None if all are exact. InputError if p1 or p3 is known exactly although the mass
    that is added to it is not.
    """
    moves: dict[tuple[str, float], list[tuple[float, float]]] = {}
    zero = (0.0, 0.0)
    for position, added in enumerate(carried.values()):
        for key, by_inertia, by_gravity in _moves(added):
            own = moves.setdefault(key, [zero] * len(carried))
            own[position] = (by_inertia, by_gravity)
    if not moves:
        return None
    shares = np.array(list(moves.values()))  # (q, k, 2)
    result = np.zeros((*rows.shape[:2], shares.shape[0]))
    for part, name in enumerate(("p1", "p3")):
        if not shares[:, :, part].any():
            continue
        if name not in names:
            expected = f"added masses that are exact, or {name} with an uncertainty"
            raise InputError("known", name, "an exact value beside uncertain masses", expected)
        column = rows[:, :, list(names).index(name)]
        result += column[:, :, None] * shares[:, :, part].T[:, None, :]
    return result


def _moves(added: AddedMass) -> list[tuple[tuple[str, float], float, float]]:
    """Return what a standard uncertainty of a mass, and of its arm, adds to inertia and gravity."""
    found = []
    if added.mass_uncertainty and added.mass:
        share = added.mass_uncertainty / added.mass
        found.append(
            (("mass", rounded(added.mass)), share * added.inertia, share * added.gravity_moment)
        )
    if added.arm_uncertainty and added.arm:
        share = added.arm_uncertainty / added.arm
        found.append(
            (("arm", rounded(added.arm)), 2 * share * added.inertia, share * added.gravity_moment)
        )
    return found
