"""Which terms are fitted: those that help to predict logs that were left out.

Of all sets of terms that are offered the one is sought that foretells best what it has not seen
(cross-validation; Stone, J. R. Statist. Soc. B 36, 1974), and of those that do so about as well the
smallest (the rule of one standard error; Breiman et al., Classification and Regression Trees, 1984,
section 3.4.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterator, Sequence

    from numpy.typing import NDArray

    from butterfly.identify.judgement.nested import Nested

    Samples = NDArray[np.float64]


class _Trial(NamedTuple):
    """A set of terms, where it was fitted, and (k,) errors of logs that it had not seen."""

    terms: tuple[str, ...]
    nested: Nested
    errors: Samples

    @property
    def score(self) -> float:
        return float(self.errors.mean())


@dataclass(frozen=True, kw_only=True, eq=False)
class TermChoice:
    """Terms that were chosen, and what speaks for others.

    Parameters
    ----------
    terms
        Chosen.
    values
        Of the parameters, by name, as the nested fit foretells them.
    settings
        See `Nested`.
    rivals
        Values, by name, of the fits with other terms that predict as well, or hardly less so.
    not_helping
        Terms that were offered and not chosen.
    inseparable
        Terms among them that the data cannot tell from the rest.
    """

    terms: tuple[str, ...]
    values: dict[str, float]
    settings: dict[str, float]
    rivals: tuple[dict[str, float], ...]
    not_helping: tuple[str, ...]
    inseparable: tuple[str, ...]


def folds_of(parts: Sequence[Hashable], *, fewest: int) -> NDArray[np.intp]:
    """Number the parts that k logs belong to; each log is a part where there are too few parts.

    Parameters
    ----------
    parts
        What each log belongs to.
    fewest
        Least number of parts.
    """
    different = list(dict.fromkeys(parts))
    if len(different) < fewest:
        return np.arange(len(parts))
    return np.array([different.index(part) for part in parts])


def choose_terms(fits: Sequence[Nested], always: Sequence[str]) -> TermChoice:
    """Choose from the terms of fits that have them all.

    Parameters
    ----------
    fits
        The same equations about one or more settings, with all terms.
    always
        Parameters that every fit has.
    """
    trials = [trial for nested in fits for trial in _trials(nested, always)]
    names = dict.fromkeys(name for nested in fits for name in nested.names)
    offered = [name for name in names if name not in always]
    best = min(trials, key=lambda trial: trial.score)
    chosen = min(
        (trial for trial in trials if _as_good(trial, best)),
        key=lambda trial: (len(trial.terms), trial.score),
    )
    rivals = [trial for trial in trials if trial is not chosen and _as_good(trial, best)]
    tried = {name for trial in trials for name in trial.terms}
    return TermChoice(
        terms=chosen.terms,
        values=_values(chosen, always),
        settings=chosen.nested.settings,
        rivals=tuple(_values(trial, always) for trial in rivals),
        not_helping=tuple(name for name in offered if name not in chosen.terms and name in tried),
        inseparable=tuple(name for name in offered if name not in tried),
    )


def _trials(nested: Nested, always: Sequence[str]) -> Iterator[_Trial]:
    """Try all sets of terms that one fit has, and that have what it demands."""
    free = [name for name in nested.names if name not in {*always, *nested.demanded}]
    for count in range(len(free) + 1):
        for more in combinations(free, count):
            terms = tuple(name for name in nested.names if name in {*more, *nested.demanded})
            errors = nested.held_out(_kept(nested, always, terms))
            if errors is not None:
                yield _Trial(terms, nested, np.sqrt(errors))


def _as_good(trial: _Trial, best: _Trial) -> bool:
    """Whether a set of terms predicts as well as the best, but for a standard error."""
    worse = trial.errors - best.errors
    error = float(np.std(worse, ddof=1)) / worse.size**0.5
    return bool(worse.mean() <= error)


def _values(trial: _Trial, always: Sequence[str]) -> dict[str, float]:
    nested = trial.nested
    values = nested.fitted(_kept(nested, always, trial.terms))
    assert values is not None  # noqa: S101 - its parts determine it
    return dict(zip(nested.names, values.tolist(), strict=True)) | nested.settings


def _kept(nested: Nested, always: Sequence[str], terms: Sequence[str]) -> NDArray[np.bool_]:
    wanted = {*always, *terms}
    return np.array([name in wanted for name in nested.names])
