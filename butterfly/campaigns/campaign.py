"""Experiments on an unknown joint, each chosen from those before, and who is told of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from butterfly.campaigns.bench import RESERVE, Bench, Recording, make_contact
from butterfly.campaigns.drive import DriveFault, SafetyStop, TimeUsed, signals_wait
from butterfly.campaigns.folder import Folder, Journal, Step, log_name
from butterfly.campaigns.guard import Limits
from butterfly.campaigns.plan import (
    PROBE,
    Knowledge,
    Recipe,
    Rests,
    candidates,
    duration_of,
    played,
    probe,
    require_changed,
    require_repeated,
    validation,
)
from butterfly.errors import InputError, require_number
from butterfly.identification.design import Plan, plans
from butterfly.identification.estimate import Estimate
from butterfly.identification.identified import Identified
from butterfly.identification.physical import judge_fit
from butterfly.identification.repeatability import Repeatability, contradicting_runs
from butterfly.identification.trust import FindingKind
from butterfly.logs.log import InputKind
from butterfly.logs.motors import require_drive
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, JointKind
from butterfly.model.prior import Prior
from butterfly.plant.motor import Motor, Reading
from butterfly.verdict import Level


class CampaignCallbacks:
    """Is called at each phase and each cycle; this one does nothing. Any method may be replaced.

    What a method raises ends the campaign, with the drive off.
    """

    def begin(self, announcement: Sequence[str]) -> None:
        """Take what will be played, the limits and how to stop it, before the first motion."""

    def phase(self, sentence: str) -> None:
        """Take a sentence on what begins now and why, or on what came of it."""

    def cycle(self, reading: Reading, command: float) -> None:
        """Take a reading, and the command that was set after it."""


def announcement(
    limits: Limits,
    kind: InputKind,
    journal: Journal | None,
    *,
    goal: float,
    masses: Sequence[AddedMass],
    folder: Path,
) -> list[str]:
    """Return what will be played, for what and within which limits; ``journal``: of a former part.

    ``goal`` is a share of the values; ``folder`` is where runs are kept.
    """
    within = [f"command {limits.command:g} {kind.unit}", f"angle {limits.angle:g} rad from rest"]
    within += [f"speed {limits.speed:g} rad/s"] * math.isfinite(limits.speed)
    within += [f"current {limits.current:g} A"] * math.isfinite(limits.current)
    begins = "begins with small pushes either way, then plays"
    steps = () if journal is None else journal.steps
    if journal is not None:
        begins = f"continues after {len(steps)} run{'s' if len(steps) != 1 else ''}: it plays"
    budget = limits.seconds - (steps[-1].seconds if steps else 0.0)
    with_masses = f", with {' and '.join(map(str, masses))}" if len(masses) > 1 else ""
    return [
        f"Goal: parameters known to {100 * goal:.3g} %{with_masses}; runs are kept in {folder}.",
        f"The campaign {begins} swings of at most {RESERVE * limits.angle:.2g} rad, each followed "
        f"by a pause with the drive off; {budget:.0f} s of robot time at most.",
        f"Limits: {', '.join(within)}. Beyond one of them the joint is braked, then the drive "
        "switched off.",
    ]


def time_left(budget: float, remaining: float) -> str:
    """Return how much of the robot time is left in s, and what the plan still needs, if known."""
    if math.isnan(remaining):
        return f"{budget:.0f} s of robot time left."
    return f"About {remaining:.0f} s of robot time to the goal; {budget:.0f} s left."


GOAL = 0.01
"""Half-width of the 95 % interval, over the value, that is asked of p1..p4 and Coulomb friction."""

MountMass = Callable[[AddedMass], None]
"""Mounts a mass, and returns when it is mounted."""

_OVER = 2.5  # command of the first relay, over what moves the joint: friction never holds it
_SPEED_OVER = 0.1  # s, over which the speed of a run is measured
_IN_VAIN = 5  # runs in a row that may bring too little
_REACHED = "the goal is reached"
_RATIOS = "the ratios to p1 reach the goal; more needs another mass, or a known value"
_TOUCHED = "check that the encoder does not slip, and that no end stop or cable touches the joint"


@dataclass(frozen=True, kw_only=True)
class CampaignOptions:
    """What a campaign is to reach, with what."""

    goal: float = GOAL
    limits: Limits
    masses: tuple[AddedMass, ...] = (NO_ADDED_MASS,)  # at hand; the first one is mounted
    known: dict[str, Any] = field(default_factory=dict)  # as in a manifest
    of_model: dict[str, Any] = field(default_factory=dict)  # fields of it that a model gives
    price: float = 120.0  # of a change of mass, in s of robot time
    step: float = 0.002  # cycle of the controller in s

    def __post_init__(self) -> None:
        require_number("campaign", positive=True, goal=self.goal, step=self.step)
        require_number("campaign", price=self.price)
        if not self.masses:
            raise InputError("campaign", "masses", "none", "at least one: that of the bare joint")
        Prior.of(self.known)


@dataclass(frozen=True, kw_only=True, eq=False)
class CampaignResult:
    """What a campaign came to."""

    journal: Journal
    identified: Identified | None
    reached: bool  # whether all of `OF_GOAL` are claimed to the goal, under a verdict *good*
    ending: str  # why it ended, in words


def conduct(
    motor: Motor,
    wish: CampaignOptions,
    folder: Folder,
    carry: MountMass | None = None,
    callbacks: CampaignCallbacks | None = None,
) -> CampaignResult:
    """Run a campaign, or continue one, to its end.

    ``carry`` mounts a mass, or asks a person to, and returns when it is mounted; without it the
    mass is never changed. The drive is off whenever nothing is played.
    """
    callbacks = callbacks or CampaignCallbacks()
    masses = wish.masses if carry is not None else wish.masses[:1]
    bench = Bench(motor, wish.limits, wish.step, callbacks.cycle)
    try:
        return _Campaign(bench, replace(wish, masses=masses), folder, carry, callbacks).run()
    finally:
        bench.make_sure_it_is_off()


class _Next(NamedTuple):
    """What to play next and why; without a recipe, why nothing."""

    why: str
    recipe: Recipe | None = None
    expected: float | None = None  # largest share after it
    remaining: float = math.nan  # s of robot time to the goal, by the plan


class _Campaign:
    """The state of a campaign between two runs."""

    def __init__(
        self,
        bench: Bench,
        wish: CampaignOptions,
        folder: Folder,
        carry: MountMass | None,
        callbacks: CampaignCallbacks,
    ) -> None:
        self._bench, self._wish, self._folder, self._carry = bench, wish, folder, carry
        self._callbacks = callbacks
        self._mounted = wish.masses[0]
        self._is_certain = True  # what is mounted; after a pause somebody may have changed it
        self._knowledge: Knowledge  # begins with what is known, by the journal too
        self._last_sound: Identified | None = None
        self._size = 0.0  # of a relay's command, so far
        self._rests, self._repeatability = Rests(), Repeatability()

    def run(self) -> CampaignResult:
        """Go on until the goal is reached, or nothing more can be done."""
        self._begin()
        ending = ""
        while not ending:
            following = self._next()
            if following.recipe is None:
                ending = following.why
            else:
                try:
                    self._play(following)
                except TimeUsed as error:
                    ending = str(error)
        self._callbacks.phase(f"The campaign ends: {ending}.")
        model = self._knowledge.sound
        if model is not None and self._folder.journal.steps[-1].held_out is False:
            least = self._folder.journal.contact.breakaway
            kind, mass = self._bench.input_kind, self._mounted
            unseen = validation(model.estimate, mass, self._wish.limits, kind, least)
            try:
                self._play(_Next("to test the prediction on a held-out run", unseen), held_out=True)
            except TimeUsed as error:
                ending = f"{error}, before a held-out run could test the prediction"
        seen = {} if self._knowledge.sound is None else self._knowledge.sound.held_out
        if any(judge_fit(np.array([fit])) for fit in seen.values()):
            ending = f"the model does not predict the last run, which was held out; {_TOUCHED}"
        journal, reached = self._folder.journal, ending == _REACHED and bool(seen)
        return CampaignResult(
            journal=journal, identified=self._knowledge.model, reached=reached, ending=ending
        )

    def _begin(self) -> None:
        """Make contact, or take up where the journal ends."""
        before = self._folder.journal if self._folder.is_begun else None
        self._require_mass_at_hand(before)
        wish, kind = self._wish, self._bench.input_kind
        require_drive(Prior.of(wish.known), kind, JointKind.HINGE, "campaign")
        masses, place = wish.masses, self._folder.path
        lines = announcement(wish.limits, kind, before, goal=wish.goal, masses=masses, folder=place)
        self._callbacks.begin(lines)
        if self._folder.is_begun:
            journal = self._folder.journal
            self._require_same_joint(journal)
            journal = replace(journal, known=journal.known | self._wish.known)
        else:
            self._callbacks.phase(
                "Contact: the command grows until the joint moves, in either direction."
            )
            with self._bench as bench:
                contact = make_contact(bench)
            side = "positive" if contact.polarity > 0 else "negative"
            self._callbacks.phase(
                f"The joint breaks away at {contact.breakaway:.3g} {kind.unit}; positive commands "
                f"turn it towards {side} angles."
            )
            journal = Journal(
                input_kind=kind, contact=contact, known=wish.known, of_model=wish.of_model
            )
        self._folder.begin(journal)  # whose manifest a kill may have left ahead of it
        self._wish = replace(self._wish, known=journal.known)
        self._knowledge = Knowledge(self._bench, self._folder, wish.goal, masses, journal.known)
        contact, steps = journal.contact, journal.steps
        bench = self._bench
        bench.polarity, bench.guard.breakaway = contact.polarity, contact.breakaway
        self._size = _OVER * contact.breakaway
        if steps:
            bench.used = steps[-1].seconds
            self._mounted = steps[-1].added_mass
            self._require_last_run_sound()
            self._knowledge.identify()
            zeros = {} if self._knowledge.sound is None else self._knowledge.sound.zeros
            for number, step in enumerate(steps):
                if (zero := zeros.get(log_name(number))) is not None:
                    self._rests.take(step.added_mass, zero)
        self._is_certain = before is None or self._carry is None

    def _require_mass_at_hand(self, journal: Journal | None) -> None:
        """Raise InputError if the last run had another mass and nobody can change it."""
        mass, steps = self._wish.masses[0], () if journal is None else journal.steps
        if self._carry is None and steps and steps[-1].added_mass != mass:
            expected = f"{steps[-1].added_mass}, as in the last run, or somebody to change it"
            raise InputError("campaign", "masses", str(mass), expected)

    def _require_same_joint(self, journal: Journal) -> None:
        """Raise InputError if the journal is of a joint of another model, or of none."""
        begun, asked = (of.get("of", "none") for of in (journal.of_model, self._wish.of_model))
        if journal.of_model != self._wish.of_model:
            expected = f"{begun}, in the pose and model that the campaign was begun with"
            raise InputError("campaign", "of", asked, expected)

    def _require_last_run_sound(self) -> None:
        """Check a run that a former part of the campaign kept, but did not come to check."""
        require_repeated(contradicting_runs(self._folder.data().whole))
        *earlier, last = self._folder.journal.steps
        if earlier and not last.is_sound:
            runs = slice(0, len(earlier))
            before = self._knowledge.identified(runs)
            used = before is not None and before.estimate.level is not Level.WARNING
            self._require_mass_changed(before if used else None)

    def _mount(self, mass: AddedMass) -> None:
        """Have a mass mounted, if it is not for certain; the drive is off meanwhile."""
        if self._carry is not None and (mass != self._mounted or not self._is_certain):
            self._carry(mass)
            self._bench.loaded_anew()
        self._mounted, self._is_certain = mass, True

    def _play(self, following: _Next, *, held_out: bool = False) -> None:
        """Play a recipe, keep its log if it is sound, and identify."""
        recipe, bench, before = following.recipe, self._bench, self._knowledge.sound
        assert recipe is not None  # noqa: S101 - see `run`
        number = len(self._folder.journal.steps)
        self._mount(recipe.added_mass)
        budget = time_left(self._wish.limits.seconds - bench.used, following.remaining)
        self._callbacks.phase(
            f"Run {number}, {recipe.added_mass}: {recipe.what} ({recipe.duration:.3g} s): "
            f"{following.why}. {budget}"
        )
        about = {"why": following.why, "expected": following.expected, "held_out": held_out}
        self._record(recipe, about)
        self._callbacks.phase("The drive is off; identifying the joint from the runs so far.")
        try:
            self._require_sound(before)
        except SafetyStop:
            self._folder.withdraw()
            raise
        bench.guard.sound_run()
        self._knowledge.identify()
        step = replace(self._folder.journal.steps[-1], is_sound=True)
        model = self._knowledge.model
        if model is not None:
            estimate = model.estimate
            shares = {} if held_out else self._knowledge.shares
            verdict, misses = estimate.level.verdict, _missed(estimate)
            self._folder.conclude(replace(step, verdict=verdict, misses=misses, shares=shares))
            fits = [f"predicted with a FIT of {fit:.3g} %" for fit in model.held_out.values()]
            came = [_widest(shares)] if shares else fits
            self._callbacks.phase(f"Run {number}: {'; '.join([verdict, *came])}.")
        else:
            self._folder.conclude(step)
            self._callbacks.phase(f"Run {number}: no model follows the runs so far.")

    def _record(self, recipe: Recipe, about: dict[str, Any]) -> None:
        """Play a recipe from rest to rest and keep its log, ``about`` being fields of its step."""
        bench, mass, run = self._bench, recipe.added_mass, None
        known = {"what": recipe.what, "kind": recipe.kind, "added_mass": mass, **about}
        begun = len(self._folder.journal.steps)
        try:
            with bench:
                run = self._played(recipe)
                if run.fault is not None:
                    raise run.fault
                bench.settle()
                if bench.has_moved(run):
                    step = Step(seconds=bench.used, cut=run.cut, **known)
                    with signals_wait():
                        self._folder.add(run, step)
        except BaseException as error:  # whatever it is, the run was played to its end
            is_kept = len(self._folder.journal.steps) > begun
            if run is not None and bench.has_moved(run) and not is_kept:
                with signals_wait():
                    self._keep(run, Step(seconds=bench.used, cut=run.cut, **known), error)
            raise
        if not bench.has_moved(run):
            raise SafetyStop(
                "the joint no longer moves when it is driven: check supply, enable, end stops, and "
                "the encoder's cable and mount"
            )

    def _played(self, recipe: Recipe) -> Recording:
        """Return a run from rest; learn from it how to brake, and how large relays are."""
        bench, mass, before = self._bench, recipe.added_mass, self._knowledge.sound
        self._last_sound = before or self._last_sound
        bench.expect(self._knowledge.expected(mass))
        if before is not None and self._knowledge.is_known(mass):
            bench.braked_with(self._size, *self._knowledge.damping(before, mass, self._size))
        if bench.is_loaded_anew:
            bench.settle()
            self._rests.require_no_slip(bench.rest, mass, self._last_sound)
            bench.expect(self._knowledge.expected(mass))
        law = recipe.law(bench.home)
        run = bench.run(law, recipe.duration, recipe.reach)
        size = getattr(law, "size", 0.0)
        if before is None and run.angle.size:
            fast = _speed(run)
            bench.braked_with(max(self._size, size), fast, float(np.ptp(run.angle)) / 2)
        self._size = size / 2 if run.cut and size else max(self._size, size)
        return run

    def _keep(self, run: Recording, step: Step, error: BaseException) -> None:
        """Keep a finished run after which something was raised; beside, if the joint may be it."""
        stop = _stop_behind(error)
        if stop is None:
            self._folder.add(run, step)
        else:  # what was wrong then may have been before
            self._folder.set_aside(run, step)
            self._callbacks.phase(f"{str(stop)[:1].upper()}{str(stop)[1:]}.")

    def _require_sound(self, before: Identified | None) -> None:
        """Raise `SafetyStop` if the last run, whose log is kept, is not as it is said to be."""
        self._rests.require_no_slip(self._bench.rest, self._mounted, self._last_sound)
        self._require_mass_changed(before)
        data = self._folder.data().whole
        require_repeated(self._repeatability.contradiction(data, len(data.logs) - 1))

    def _require_mass_changed(self, before: Identified | None) -> None:
        """Raise `SafetyStop` if the last run, with another mass, shows the joint as before."""
        steps = self._folder.journal.steps
        old, new = ([*([steps[-1]] * 2), *steps])[-2:]
        last = slice(len(steps) - 1, None)
        require_changed(before, old, new, lambda: self._knowledge.identified(last))

    def _next(self) -> _Next:
        """Return what to play next, or why nothing."""
        wish, limits, model = self._wish, self._wish.limits, self._knowledge.sound
        vain = self._folder.journal.in_vain
        given_up = len(vain) >= _IN_VAIN
        if model is None:
            first = probe(self._mounted, self._size, limits, PROBE)
            failed = f"the model does not follow these runs; {_TOUCHED}"
            return _Next(failed) if given_up else _Next("to see how it moves", first)
        others = [mass for mass in wish.masses if mass != self._mounted]
        changes = self._knowledge.is_open and others  # without another mass no scale
        if self._knowledge.is_reached and not changes:
            return _Next(_RATIOS if self._knowledge.is_open else _REACHED)
        plan = None
        if not (self._knowledge.is_reached or given_up):
            plan = self._plan(model, [] if self._knowledge.is_open else others, vain)
        if changes and (plan is None or plan.cost > (limits.seconds - self._bench.used) / 2):
            heaviest = max(others, key=lambda mass: mass.inertia_and_moment)
            seconds = max(PROBE, duration_of(model.parameters, self._mounted, limits))
            mount = probe(heaviest, self._size, limits, seconds)
            return _Next("another mass gives the scale", mount)
        stays = _widest(self._knowledge.shares)
        if given_up:
            return _Next(f"{stays}, and the last {len(vain)} runs improved it too little")
        if plan is None:  # by a model that hardly knows
            again = probe(self._mounted, self._size, limits, PROBE)
            return _Next(f"{stays}, and no planned run stays within the limits", again)
        runs = f"; {plan.runs} such runs are" if plan.runs > 1 else "; one such run is"
        runs += " expected to suffice"
        seconds = plan.seconds
        if plan.expected[1] > 1:
            runs, seconds = ", and this run reduces it most", math.nan
        return _Next(stays + runs, plan.recipe, plan.expected[0], seconds)

    def _plan(
        self, model: Identified, others: list[AddedMass], vain: list[Step]
    ) -> Plan[Recipe] | None:
        """Return the best plan with the mounted mass, or others, unlike what was in vain."""
        estimate, limits, kind = model.estimate, self._wish.limits, self._bench.input_kind
        least = self._folder.journal.contact.breakaway
        unlike = {(step.kind, step.added_mass) for step in vain}
        logs = [
            (recipe, log)
            for mass in [self._mounted, *others]
            if (expected := self._knowledge.expected(mass))
            for recipe in candidates(estimate, mass, limits, kind, least)
            if (recipe.kind, mass) not in unlike
            and (log := played(model.data, estimate, recipe, limits, expected))
        ]
        aim, mounted, price = self._knowledge.wanted(model), self._mounted, self._wish.price
        every = plans(model.data, estimate, logs, aim, mounted=mounted, price=price)
        budget = limits.seconds - self._bench.used

        def rank(plan: Plan[Recipe]) -> tuple[bool, float]:
            falls_short = plan.expected[1] > 1 or plan.seconds - plan.change > budget
            return falls_short, plan.cost

        return min(every, key=rank, default=None)


def _speed(run: Recording) -> float:
    """Return the rms speed of a run in rad/s, over times in which an encoder's noise is little."""
    over = np.searchsorted(run.time, _SPEED_OVER)
    moved = run.angle[over:] - run.angle[: run.angle.size - over]
    return float(np.sqrt(np.mean(np.square(moved)))) / _SPEED_OVER if moved.size else 0.0


def _stop_behind(error: BaseException | None) -> SafetyStop | None:
    """Return the stop of the joint, if one led to an error or was interrupted by it."""
    while error is not None:
        if isinstance(error, SafetyStop) and not isinstance(error, DriveFault):
            return error
        error = error.__context__
    return None


def _widest(shares: dict[str, float]) -> str:
    """Say which interval is the widest in proportion to the one that is wanted."""
    name, share = max(shares.items(), key=lambda pair: pair[1])
    if share <= 1:
        return f"all intervals are within the goal, that of {name} at {share:.0%} of it"
    return f"the interval of {name} is {share:.3g} times as wide as the goal"


def _missed(estimate: Estimate) -> str:
    """Say what the model misses, by the engine's tests; empty if nothing."""
    findings = {finding.kind: finding for finding in estimate.findings}
    missing, beyond = findings.get(FindingKind.MISSING_TERM), findings.get(FindingKind.MISFIT)
    misses = [missing.parameters[0]] if missing else []
    misses += [f"error {beyond.number:.2g} times the noise"] if beyond and beyond.number else []
    return ", ".join(misses)
