"""Campaigns as they end, of runs that nobody made."""

from dataclasses import replace
from pathlib import Path

from butterfly.api.campaigns import campaign_answer
from butterfly.campaigns.bench import Contact, Limits
from butterfly.campaigns.campaign import CampaignOptions, CampaignResult
from butterfly.campaigns.folder import Journal, Step
from butterfly.identification.design import OF_GOAL
from butterfly.logs.log import InputKind
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass

MASS = AddedMass(mass=0.12, arm=0.104)
WISH = CampaignOptions(limits=Limits(command=1.0), masses=(NO_ADDED_MASS, MASS))
BREAKAWAY = 0.04
FIT = 99.6


def step(seconds, shares, mass=NO_ADDED_MASS, **more):
    about = {"what": "relay of 0.2 rad, then free", "why": "to see", "verdict": "good"} | more
    return Step(added_mass=mass, seconds=seconds, shares=shares, **about)


RATIOS = {"p2": 0.16, "p3": 0.02, "p4": 0.04, "coulomb": 0.3}
VALIDATION = step(50.0, {}, MASS, held_out=True, verdict="")


def ended(found, *steps, **more):
    journal = Journal(input_kind=InputKind.VOLTAGE, contact=Contact(1, BREAKAWAY), steps=steps)
    return CampaignResult(
        **{"journal": journal, "identified": found, "reached": True, "ending": ""} | more
    )


def shares_of(estimate, goal):
    """Half-widths over a goal in the values, by hand."""
    return {
        name: max(upper - value, value - lower) / (goal * abs(value))
        for name, value, lower, upper in zip(
            estimate.names, estimate.values, estimate.lower, estimate.upper, strict=True
        )
        if name in OF_GOAL
    }


def told(result, wish=WISH, **more):
    """The campaign of an estimate in two runs, and one that was held out."""
    known = step(36.0, shares_of(result.estimate, wish.goal), MASS)
    steps = more.pop("steps", (step(20.0, RATIOS), known, VALIDATION))
    return campaign_answer(ended(result, *steps, **more), wish, Path("my folder"))


def within_goal(result):
    """The campaign of an estimate that reached its goal and foretold what was held out."""
    return told(replace(result, held_out={"run_002.parquet": FIT}))
