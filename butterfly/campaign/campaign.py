"""Experiments on an unknown joint that choose themselves, until the goal is reached.

Contact; a probe of little reach; then, after each run, identification by the same engine as of any
logs, and the run from which the goal is reached for the least cost. While only one mass was seen
the scale is open, and ratios to p1 are asked for, at half the goal: the scale follows from two
configurations, whose errors add. At the end a run that was not fitted is predicted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from butterfly.arrays import Samples
from butterfly.campaign.bench import Bench, Limits, SafetyStop
from butterfly.campaign.contact import Contact, make_contact
from butterfly.campaign.design import (
    RESERVE,
    Recipe,
    best_plan,
    candidates,
    duration_of,
    information,
    probe,
)
from butterfly.campaign.folder import Folder, Journal, Step
from butterfly.errors import ButterflyError, IdentifiabilityError, InputError, require_number
from butterfly.identification.identified import Identified
from butterfly.identification.identify import identify
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.inference.identifiability import with_scale
from butterfly.identification.levels import PRECISE
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass
from butterfly.model.prior import Prior
from butterfly.model.terms import PARAMETERS
from butterfly.plant.motor import Motor
from butterfly.verdict import Level

GOAL = 0.01
"""Half-width of the 95 % interval, over the value, that is asked of p1..p4 and Coulomb friction."""

OF_GOAL = tuple(name for name in PARAMETERS if name != "delay")
"""Parameters that the goal concerns."""

_OPEN = 0.5  # share of the goal that ratios have to reach while the scale is open
_OVERHEAD = 3.0  # s between two runs
_PROBE = 12.5  # s of a probe
_PROBES = 3  # that may give no estimate


@dataclass(frozen=True, kw_only=True)
class Wish:
    """What a campaign is to reach, with what."""

    goal: float = GOAL
    limits: Limits
    masses: tuple[AddedMass, ...] = (NO_ADDED_MASS,)
    """Masses at hand; the first is mounted at the beginning."""
    known: dict[str, Any] = field(default_factory=dict)
    """Known values, as in a manifest."""
    price: float = 120.0
    """Of a change of mass, in s of robot time."""
    step: float = 0.002
    """Cycle of the controller in s."""

    def __post_init__(self) -> None:
        require_number("campaign", positive=True, goal=self.goal, step=self.step)
        require_number("campaign", price=self.price)
        if not self.masses:
            raise InputError("campaign", "masses", "none", "at least one: that of the bare joint")
        Prior.of(self.known)


@dataclass(frozen=True, kw_only=True, eq=False)
class Ended:
    """What a campaign came to."""

    journal: Journal
    identified: Identified | None
    reached: bool
    """Whether all of `OF_GOAL` are claimed to the goal, under a verdict *good*."""
    ending: str
    """Why it ended, in words."""


def conduct(
    motor: Motor, wish: Wish, folder: Folder, carry: Callable[[AddedMass], None] | None = None
) -> Ended:
    """Run a campaign, or go on with one, to its end.

    ``carry`` mounts a mass, or asks a person to, and returns when it is mounted; without it the
    mass is never changed.
    """
    masses = wish.masses if carry is not None else wish.masses[:1]
    bench = Bench(motor, wish.limits, wish.step)
    with bench:
        return _Campaign(bench, replace(wish, masses=masses), folder, carry).run()


class _Campaign:
    def __init__(
        self,
        bench: Bench,
        wish: Wish,
        folder: Folder,
        carry: Callable[[AddedMass], None] | None,
    ) -> None:
        self._bench, self._wish, self._folder, self._carry = bench, wish, folder, carry
        self._mounted = wish.masses[0]
        self._found: Identified | None = None
        self._size = 0.0  # of a relay's command, so far

    def run(self) -> Ended:
        contact = self._contact()
        self._bench.polarity, self._size = contact.polarity, 2 * contact.breakaway
        failed, ending = 0, ""
        if self._folder.journal.steps:
            self._bench.used = self._folder.journal.steps[-1].seconds
            self._mount(self._folder.journal.steps[-1].added_mass, always=True)
            self._identify()
        while not ending:
            recipe, why = self._next()
            if recipe is None:
                ending = why
                break
            if self._bench.used + recipe.duration > self._wish.limits.seconds:
                ending = f"the robot time of {self._wish.limits.seconds:g} s is used up"
                break
            self._play(recipe, why)
            failed = 0 if self._found is not None else failed + 1
            if failed == _PROBES:
                ending = "these runs do not determine the parameters"
        found = self._found
        reached = found is not None and not self._open() and self._is_reached(found.estimate)
        return Ended(
            journal=self._folder.journal, identified=found, reached=reached, ending=ending
        )

    def _contact(self) -> Contact:
        if self._folder.journal is None:
            contact = make_contact(self._bench)
            kind = self._bench.input_kind
            self._folder.begin(Journal(input_kind=kind, contact=contact, known=self._wish.known))
        return self._folder.journal.contact

    def _mount(self, mass: AddedMass, *, always: bool = False) -> None:
        if (mass != self._mounted or always) and self._carry is not None:
            self._bench.changed(lambda: self._carry(mass))
            self._mounted = mass

    def _play(self, recipe: Recipe, why: str) -> None:
        """Play a recipe, keep its log, and identify."""
        self._mount(recipe.added_mass)
        bench = self._bench
        bench.settle()
        law = recipe.law(bench.rest)
        run = bench.run(law, recipe.duration)
        self._size = max(self._size, getattr(law, "size", 0.0))
        bench.braked_with(self._size, max(float(np.std(np.diff(run.angle))) / bench.step, 1e-2))
        step = Step(
            what=recipe.what,
            why=why,
            added_mass=recipe.added_mass,
            seconds=bench.used,
            cut=run.cut,
        )
        self._folder.add(run, step)
        self._identify()
        if self._found is not None:
            estimate = self._found.estimate
            shares = self._shares(estimate)
            level = estimate.level.verdict
            step = replace(step, verdict=level, half_widths=shares)
            self._folder.conclude(step)

    def _identify(self) -> None:
        """Identify from all logs so far; ratios to p1 while the scale is open."""
        data = self._folder.data()
        if self._open():
            data = data.knowing(Prior.of({"p1": 1.0}))
        try:
            self._found = identify(data)
        except ButterflyError:
            self._found = None

    def _open(self) -> bool:
        """Whether the runs so far leave the scale open."""
        masses = {step.added_mass for step in self._folder.journal.steps}
        try:
            with_scale(masses, Prior.of(self._wish.known))
        except IdentifiabilityError:
            return True
        return False

    def _wanted(self, estimate: Estimate) -> Samples:
        """Return (n,) half-widths that the goal asks for, infinite where it asks for none."""
        share = self._wish.goal * (_OPEN if self._open() and len(self._wish.masses) > 1 else 1.0)
        speed = float(np.median([log.rms_speed for log in self._found.data.logs]))
        friction = abs(estimate.named.get("p2", 0.0)) * speed + estimate.named.get("coulomb", 0.0)
        wanted = []
        for name, value in estimate.named.items():
            size = abs(value) if name in OF_GOAL else math.inf
            if name in {"p2", "coulomb"}:  # one that is a small share of all friction matters less
                size = max(size, PRECISE * friction / (speed if name == "p2" else 1.0))
            wanted.append(share * size)
        return np.array(wanted)

    def _shares(self, estimate: Estimate) -> dict[str, float]:
        """Return the half-widths over those that are wanted, by name."""
        half = np.maximum(estimate.upper - estimate.values, estimate.values - estimate.lower)
        shares = half / self._wanted(estimate)
        pairs = zip(estimate.names, shares.tolist(), strict=True)
        return {name: share for name, share in pairs if name in OF_GOAL}

    def _is_reached(self, estimate: Estimate) -> bool:
        good = estimate.level is Level.GOOD
        return good and max(self._shares(estimate).values()) <= 1

    def _next(self) -> tuple[Recipe | None, str]:
        """Return what to play next and why; or nothing, and why not."""
        wish, limits = self._wish, self._wish.limits
        if self._found is None:
            return probe(self._mounted, self._size, limits, _PROBE), "to see how it moves"
        estimate, opened = self._found.estimate, self._open()
        others = [mass for mass in wish.masses if mass != self._mounted]
        if self._is_reached(estimate) and not (opened and others):
            return None, "the goal is reached"
        masses = [self._mounted, *([] if opened else others)]
        plan = best_plan(
            estimate,
            sum(information(estimate, *each) for each in _with_zeros(self._found)),
            [recipe for mass in masses for recipe in candidates(estimate, mass, limits)],
            self._wanted(estimate),
            limits,
            mounted=self._mounted,
            price=wish.price,
            overhead=_OVERHEAD,
        )
        left = limits.seconds - self._bench.used
        if opened and others and (self._is_reached(estimate) or not plan or plan.cost > left / 2):
            heaviest = max(others, key=lambda mass: mass.inertia_and_moment)
            seconds = max(_PROBE, duration_of(estimate.parameters, self._mounted))
            return probe(heaviest, self._size, limits, seconds), "another mass gives the scale"
        if plan is None:
            return None, "no run stays within the limits"
        worst = max(self._shares(estimate).items(), key=lambda pair: pair[1])
        return plan.recipe, f"{worst[0]} is {worst[1]:.3g} times the goal; {plan.runs} such runs"


def _with_zeros(found: Identified) -> list[tuple[Any, float]]:
    return [(log, offset.value) for log, offset in zip(found.data.logs, found.data.offsets, strict=True)]
