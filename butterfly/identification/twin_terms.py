"""Absent terms that a fitted one speaks for: rivals of the values that they would move.

A spring that pulls to an angle of its own, fitted without it, leaves a bias; its stiffness is read
as a gravity moment. Where such a term, added, predicts held-out logs better, the intervals include
the values with it, however little of the error it explains.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from butterfly.arrays import Samples
from butterfly.identification.chosen_terms import FreeRunModel
from butterfly.identification.findings import Finding, FindingKind
from butterfly.identification.fit import Fit
from butterfly.identification.inference.limits import Rival, cluster_covariance, half_widths
from butterfly.identification.inference.stagewise import Offer
from butterfly.identification.levels import MATTERS
from butterfly.identification.problem import Problem
from butterfly.model.terms import PARAMETERS, TERMS


class TwinTerm(NamedTuple):
    """A term that a fit lacks, and the fit's shared values with it."""

    name: str
    rival: Rival
    moved: dict[str, float]  # parameters that it moves, and the share

    @property
    def finding(self) -> Finding:
        """What it would move, and by which share at most."""
        return Finding(
            FindingKind.LIKE_TERM, (self.name, *self.moved), number=max(self.moved.values())
        )


def spoken_for(names: Iterable[str]) -> tuple[str, ...]:
    """Return the terms that are not among some names, and that one of these speaks for."""
    has = {*names}
    return tuple(row.name for row in TERMS.values() if row.shows_as & has and row.name not in has)


def twin_terms(every: Problem, fit: Fit, rows: Iterable[str]) -> list[TwinTerm]:
    """Return those of some rows of a problem that predict better than a fit and move parameters."""
    found, model = [], FreeRunModel(every=every, fit=fit, rows=tuple(rows))
    shared = model.problem.labels[: model.problem.shared]
    for offer in (offer for name in rows for offer in model.offers([name])):
        if not (offer.ratio > 1 and model.confirms(offer.values)):
            continue
        half = dict(zip(offer.nested.names, _half_widths(offer), strict=True))
        values = np.array([offer.values[label] for label in shared])
        widths = np.array([half[label] for label in shared])
        moved = {
            label: float(abs(value / old - 1))
            for label, value, old in zip(shared, values, fit.values, strict=False)
            if label in PARAMETERS and abs(value - old) > MATTERS * abs(old)
        }
        if moved:
            found.append(TwinTerm(offer.name, Rival(values, widths), moved))
    return found


def _half_widths(offer: Offer) -> Samples:
    """(n,) half-widths of the values of a fit with a row more."""
    values = np.array([offer.values[name] for name in offer.nested.names])
    about = offer.nested.about(values).equations
    return half_widths(*cluster_covariance(*about.stack, about.prior))
