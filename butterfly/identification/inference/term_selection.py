"""Which terms help to predict logs that were left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from butterfly.identification.data import DataSet
from butterfly.identification.estimators import Estimator
from butterfly.identification.free_run import FitSummary
from butterfly.identification.inference.splits import Split, divide
from butterfly.identification.inference.validation import hold_out
from butterfly.progress import Track, untracked

_LEAST_GAIN = 0.1  # per cent of held-out FIT that a further term must bring


@dataclass(frozen=True, kw_only=True, eq=False)
class Structure:
    """A set of terms and how well it does: FIT in sample, and of logs left out."""

    terms: tuple[str, ...]
    in_sample: FitSummary
    held_out: dict[Split, FitSummary]


def select_terms(
    data: DataSet,
    estimator: Estimator,
    candidates: Sequence[str],
    *,
    track: Track = untracked,
) -> list[Structure]:
    """Add terms greedily, each time the one that most raises the mean FIT of what is left out.

    That is one added mass at a time, or what `divide` finds to suit the logs.

    Stops when no term raises it by a tenth of a per cent.

    Returns
    -------
    The structures passed through, the last being the one selected.

    Raises
    ------
    InputError
        If the estimator offers no terms, or not one of these.
    """

    def judge(terms: tuple[str, ...], split: Split) -> FitSummary:
        return hold_out(data, estimator.with_terms(terms), split).summary

    predictor, first = data.simulations, divide(data).split
    splits = [first]
    if first is Split.MASS and len({point.omega for point in data.sines}) > 1:
        splits.append(Split.FREQUENCY)
    chosen: tuple[str, ...] = ()
    best = judge(chosen, first)
    passed = [(chosen, best)]
    while rest := [term for term in candidates if term not in chosen]:
        trials = {
            term: judge((*chosen, term), first)
            for term in track(rest, f"Trying a term beside {', '.join(chosen) or 'the first six'}")
        }
        term = max(trials, key=lambda name: trials[name].mean)
        if trials[term].mean < best.mean + _LEAST_GAIN:
            break
        chosen, best = (*chosen, term), trials[term]
        passed.append((chosen, best))
    return [
        Structure(
            terms=terms,
            in_sample=FitSummary.of(predictor.fits(estimator.with_terms(terms)(data))),
            held_out={first: summary} | {each: judge(terms, each) for each in splits[1:]},
        )
        for terms, summary in track(passed, "Judging the structures")
    ]
