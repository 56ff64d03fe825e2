"""An identification as numbers for programs: beside its report, by ``--json`` and from Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identification import Identification
from butterfly.identification.physical import PhysicalParameters
from butterfly.model.parameters import LumpedParameters
from butterfly.report.finding_texts import estimate_verdict, values_of
from butterfly.report.format import fit_text
from butterfly.report.numbers.document import Told
from butterfly.report.numbers.estimate_numbers import (
    chosen_numbers,
    data_numbers,
    estimate_numbers,
    lumped_numbers,
    without_root,
)
from butterfly.report.numbers.misfit_numbers import misfit_numbers, misfit_units
from butterfly.report.physical import physical_numbers
from butterfly.report.summary import summary

KIND = "identification"

BESIDES = ("chosen", "against", "misfit")
"""Keys of what a saved identification cannot tell anew without its logs."""

_UNITS = {"fit": "%", "fit.horizon": "s", "fits": "%", "held_out": "%", "against.fit": "%"}


def origin_of(identification: Identification) -> dict[str, Any]:
    """Return what is known of the data, where its logs lie among it."""
    data = identification.data
    manifest = data.whole_manifest
    return data_numbers(data) | {"manifest": manifest and manifest.model_dump(mode="json")}


def told_identification(
    identification: Identification, truth: LumpedParameters | None = None
) -> Told:
    """Tell an identification.

    Parameters
    ----------
    identification
        The result.
    truth
        True parameters, where they are known.
    """
    besides = besides_of(identification)
    return told_of_parts(
        estimate=identification.estimate,
        label=besides["chosen"]["label"],
        origin=origin_of(identification),
        fits={run.log.name: run.fit for run in identification.free_runs},
        held_out=identification.held_out,
        said=summary(identification),
        physical=identification.physical,
        besides=besides,
        truth=truth,
    )


def besides_of(identification: Identification) -> dict[str, Any]:
    """Return what only an identification can tell that has its logs, by the keys `BESIDES`."""
    estimate = identification.estimate
    return {
        "chosen": chosen_numbers(identification.estimator, estimate),
        "against": [
            {
                "name": other.name,
                "parameters": lumped_numbers(other.parameters, estimate),
                "gain_fitted": other.gain_fitted,
                "fit": other.summary.numbers(),
            }
            for other in identification.comparisons
        ],
        "misfit": misfit_numbers(identification.misfit, values_of(estimate)),
    }


def told_of_parts(
    *,
    estimate: Estimate,
    label: str,
    origin: Mapping[str, Any],
    fits: Mapping[str, float],
    held_out: Mapping[str, float],
    said: Sequence[str],
    physical: PhysicalParameters,
    besides: Mapping[str, Any],
    truth: LumpedParameters | None = None,
) -> Told:
    """Tell an identification, fresh or saved, of its parts.

    Parameters
    ----------
    estimate
        Parameters with covariance and findings.
    label
        Of what made it.
    origin
        As `origin_of` has it.
    fits, held_out
        FIT in per cent of each log, by its name, and of those that were held out.
    said
        What was found, in words, the verdict first.
    physical
        What the parameters are made of.
    besides
        As `besides_of` has it.
    truth
        True parameters, where they are known.
    """
    fit = FitSummary.of(np.array(list(fits.values())), estimate.horizon)
    return Told(
        kind=KIND,
        title=titled(label, origin["name"], fit),
        verdict=estimate_verdict(estimate),
        summary=tuple(said),
        content={
            "estimator": label,
            "data": {**origin, "manifest": without_root(origin["manifest"])},
            **estimate_numbers(estimate, truth),
            "fit": fit.numbers(),
            "fits": dict(fits),
            "held_out": dict(held_out),
            "physical": physical_numbers(physical),
            **besides,
        },
        units=_UNITS | misfit_units(estimate.joint),
    )


def titled(label: str, name: str, fit: FitSummary) -> str:
    """Return an identification in a line."""
    return f"{label} of {name!r}, median FIT{fit.over} {fit_text(fit.median)} %"
