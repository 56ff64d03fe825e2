"""A fit whose scale rests on one uncertain value: solved with it held, then given its share.

Where all logs carry the same, the equations are homogeneous: p1..p4, the carried inertia and moment
among them, times any number are as good. Noise in the regressors would make least squares prefer
small numbers. So what tells the scale best is held, and its column is what homogeneity says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.equations import CellEquations, scaled_least_squares
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import Penalty, Prior
from butterfly.model.terms import PARAMETERS, SHARES, TERMS


@dataclass(frozen=True, kw_only=True)
class ScaleParameter:
    """What tells the scale of logs."""

    # the parameter that is held; None where masses, or what is known exactly, tell the scale
    name: str | None
    known: Prior
    added: AddedMass  # what all logs carry

    @classmethod
    def of(
        cls, masses: Sequence[AddedMass], known: Prior, *, driven: bool = True
    ) -> ScaleParameter:
        """Find it for logs with some masses; of undriven ones p4 tells nothing."""
        same = len({mass.inertia_and_moment for mass in masses}) == 1
        telling = known if driven else known.within(known.parameters.keys() - {"p4"})
        name = telling.reference(masses[0]) if same else None
        return cls(name=name, known=known, added=masses[0])

    @property
    def fixed(self) -> Prior:
        """What is known, with the reference held."""
        return self.known if self.name is None else self.known.fixing(self.name)

    def grown(self, values: Samples, names: Sequence[str]) -> Samples:
        """Return (n,) values of a fit that held the reference, with its own in its place."""
        if self.name is None:
            return values
        return np.insert(values, self._place(names), self.known.parameters[self.name].value)

    def whole(self, solved: CellEquations) -> CellEquations:
        """Return the end of a fit that held the reference, with it and its uncertainty."""
        if self.name is None:
            return solved
        values, at = self.grown(solved.values, solved.names), self._place(solved.names)
        names = (*solved.names[:at], self.name, *solved.names[at:])
        turned = np.insert(np.eye(len(solved.names)), at, self._shares(solved), axis=1)
        about = dict(zip(names, values.tolist(), strict=True))
        prior = Penalty.of(names, self.known.parameters, solved.realised_variance, about)
        assert prior is not None  # noqa: S101 - the reference is uncertain
        bread = solved.bread
        if bread is not None:
            of_logs = bread if solved.prior is None else bread - solved.prior.curvature
            bread = turned.T @ of_logs @ turned + prior.curvature
        whole = replace(
            solved,
            names=names,
            values=values,
            rows=solved.rows @ turned,
            on_bound=np.insert(solved.on_bound, at, [False]),
            lower=np.insert(solved.lower, at, TERMS[self.name].lower),
            bread=bread,
            prior=prior,
        )
        if prior.active.sum() == 1:
            return whole
        rows, left = whole.with_prior
        moved = np.maximum(values - scaled_least_squares(rows, left), whole.lower)
        return replace(
            whole, values=moved, residuals=solved.residuals + whole.rows @ (moved - values)
        )

    def _place(self, names: Sequence[str]) -> int:
        before = [*PARAMETERS, self.name]
        return sum(each in names for each in before[: before.index(self.name)])

    def _shares(self, solved: CellEquations) -> Samples:
        """(n,) changes of the others that do to residuals what one of the reference does."""
        assert self.name is not None  # noqa: S101 - asked of a reference only
        carried = {"p1": self.added.inertia, "p3": self.added.gravity_moment}
        pairs = zip(solved.names, solved.values.tolist(), strict=True)
        grown = [SHARES.get(n, 0.0) * own + carried.get(n, 0.0) for n, own in pairs]
        own = self.known.parameters[self.name].value + carried.get(self.name, 0.0)
        return -np.array(grown) / own
