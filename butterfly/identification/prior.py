"""What is known of some values with an uncertainty, beside what the logs say of them.

A prior is no cluster: it weighs 1/uncertainty^2 against rows that are scaled to the variance that
their clusters realise, and adds to the covariance what it is itself uncertain by. With the
information H of the data, the middle B of its sandwich and the prior's precision P,

    Cov = (H + P)^-1 (B + P) (H + P)^-1.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from butterfly.model.known import Known

Samples = NDArray[np.float64]

_Name = TypeVar("_Name", bound="Hashable")


@dataclass(frozen=True, kw_only=True, eq=False)
class Prior:
    """Independent knowledge of n values."""

    mean: Samples  # (n,) what they are known to be; anything where nothing is known
    # (n,) of their squares beside those of the rows: ``variance`` over that of each; 0 where
    # nothing is known
    weight: Samples
    variance: float = 1.0  # of a row whose clusters are independent, as the data realise it

    @classmethod
    def of(
        cls, names: Sequence[_Name], known: Mapping[_Name, Known], variance: float = 1.0
    ) -> Prior | None:
        """Return what is known with an uncertainty of values by name; None if it is nothing."""
        own = [known[name] if name in known and not known[name].exact else None for name in names]
        if not any(own):
            return None
        mean = np.array([each.value if each else 0.0 for each in own])
        weight = np.array([variance / each.uncertainty**2 if each else 0.0 for each in own])
        return cls(mean=mean, weight=weight, variance=variance)

    @property
    def told(self) -> NDArray[np.bool_]:
        """(n,) of which something is known."""
        return np.asarray(self.weight > 0)

    def take(self, kept: NDArray[np.intp] | NDArray[np.bool_]) -> Prior:
        """Return what is known of some of the values."""
        return replace(self, mean=self.mean[kept], weight=self.weight[kept])

    def without(self, lost: NDArray[np.bool_]) -> Prior:
        """Return what is known but of some of the values, by a mask."""
        return replace(self, weight=np.where(lost, 0.0, self.weight))

    def padded(self, count: int) -> Prior:
        """Return the prior of these values and of further ones of which nothing is known."""
        none = np.zeros(count)
        return replace(self, mean=np.append(self.mean, none), weight=np.append(self.weight, none))

    def turned(self, slope: Samples, shift: Samples) -> Prior:
        """Return what is known of (n,) slope times (value less shift)."""
        return replace(self, mean=slope * (self.mean - shift), weight=self.weight / slope**2)

    def rows(self) -> tuple[Samples, Samples]:
        """Return (k, n) rows and (k,) targets of a regression on the values."""
        root = np.sqrt(self.weight[self.told])
        return np.diag(np.sqrt(self.weight))[self.told], root * self.mean[self.told]

    def cost(self, values: Samples) -> float:
        """Return half of what (n,) values count."""
        return 0.5 * float(self.weight @ (values - self.mean) ** 2)

    def gradient(self, values: Samples) -> Samples:
        """(n,) derivatives of the cost."""
        return np.asarray(self.weight * (values - self.mean))

    @property
    def curvature(self) -> Samples:
        """(n, n) second derivatives of the cost."""
        return np.diag(self.weight)
