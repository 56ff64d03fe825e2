"""Which terms output error fits: those that help to predict the free runs of logs left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.estimators.equations import Equations
from butterfly.identification.estimators.free_run_residuals import FreeRunResiduals
from butterfly.identification.inference.identifiability import SINGULAR_CONDITION, Conditioning
from butterfly.identification.inference.submodels import Nested
from butterfly.identification.inference.term_choice import (
    NEGLIGIBLE,
    SLACK_OF_STRETCHES,
    TermChoice,
    choose_terms,
    folds_of,
    stretches_of,
)
from butterfly.model.terms import COMPANIONS, offered

Samples = NDArray[np.float64]

CANDIDATES = ("drag", "load", "bias", "p3_offset", "stribeck", "stribeck_velocity")
"""Terms that are tried where none are told."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeRunTerms:
    """A choice among the terms of residuals that have them all."""

    problem: FreeRunResiduals
    labels: tuple[str, ...]  # what its n parameters are called in the choice
    choice: TermChoice

    @classmethod
    def of(
        cls, problem: FreeRunResiduals, point: Samples, at: Equations, always: Sequence[str]
    ) -> FreeRunTerms:
        """Choose by the equations about a point.

        ``problem``, ``point``, ``at``: the residuals, (n,) scaled values of the parameters, and the
        equations about them; ``always``: names of parameters that are not to be chosen, but fitted.
        """
        labels = tuple(
            name if whose is None else f"{name} of {whose}" for name, whose in problem.keys
        )
        optional = {name for name in CANDIDATES if name not in always}
        masses = [each.log.added_mass for each in problem.simulations]
        stretches = stretches_of(len(masses))
        at = at if stretches == 1 else at.cut(stretches)
        nested = Nested(
            names=labels,
            values=point,
            lower=problem.lower,
            curvature=at.curvatures,
            gradient=at.gradients,
            cost=at.squares,
            folds=folds_of(masses) if stretches == 1 else np.arange(len(at.logs)),
            negligible=NEGLIGIBLE,
            slack=1.0 if stretches == 1 else SLACK_OF_STRETCHES,
            prior=problem.prior,
        )
        kept = tuple(label for label in labels if label not in optional)
        return cls(problem=problem, labels=labels, choice=choose_terms([nested], always=kept))

    @cached_property
    def kept(self) -> NDArray[np.intp]:
        """Numbers of the parameters that are fitted."""
        return np.flatnonzero([label in self.choice.names for label in self.labels])

    @cached_property
    def part(self) -> FreeRunResiduals:
        """The residuals with the terms that were chosen, to start from where they should end."""
        return self.problem.keeping(self.kept, self.scaled(self.choice.values))

    @property
    def rivals(self) -> tuple[Samples, ...]:
        """Values of the robot's own parameters of `part`, by fits that predict as well."""
        part = self.part
        return tuple((self.scaled(each) * part.scale)[: part.shared] for each in self.choice.rivals)

    @property
    def values(self) -> dict[str, float]:
        """Values of the parameters of the robot that are fitted, as they are predicted."""
        names = [self.labels[k] for k in self.kept.tolist() if k < self.problem.shared]
        scale = dict(zip(self.labels, self.problem.scale.tolist(), strict=True))
        return {name: self.choice.values[name] * scale[name] for name in names}

    def scaled(self, found: dict[str, float]) -> Samples:
        """Return scaled values of the parameters that are fitted."""
        return np.array([found[self.labels[k]] for k in self.kept])


def inseparable(problem: FreeRunResiduals, at: Equations) -> tuple[str, ...]:
    """Return a term, and what comes with it, that the equations cannot tell from the others."""
    rows = np.concatenate([rows for rows, _ in at.compressed()])
    names = tuple(name for name, _ in problem.keys)
    told = None if problem.prior is None else problem.prior.told
    conditioning = Conditioning.of(rows, names, told)
    doubtful = [n for n in conditioning.weakest if n in {*CANDIDATES, *offered("output-error")}]
    if conditioning.number <= SINGULAR_CONDITION or not doubtful:
        return ()
    last = doubtful[-1]
    leader = next((name for name, with_it in COMPANIONS.items() if with_it == last), last)
    return tuple(
        n for n in dict.fromkeys((leader, last, COMPANIONS.get(leader, last))) if n in names
    )
