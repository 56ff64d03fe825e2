"""An orbit that was held, and the re-calibration next to it, as numbers for programs."""

from __future__ import annotations

import math

from butterfly.document import Told
from butterfly.experiment.record import OrbitRecord
from butterfly.logs.log import InputKind
from butterfly.model.parameters import LumpedParameters
from butterfly.orbit.loop import OrbitStudy
from butterfly.report.finding_texts import estimate_sentences, estimate_verdict
from butterfly.report.numbers.estimate_numbers import estimate_numbers, lumped_numbers


def told_orbit(study: OrbitStudy, truth: LumpedParameters | None) -> Told:
    """Tell a study of an orbit.

    `truth`: True parameters of the hand with what it carries, where they are known.
    """
    rounds, verdict = study.calibration.rounds, estimate_verdict(study.estimate)
    last, log = rounds[-1].recalibration, rounds[-1].logs[0]
    ratios = [name for name in last.names if last.is_ratio(name)]
    known = {} if truth is None else {"truth": lumped_numbers(truth, input_kind=log.input_kind)}
    return Told(
        kind="orbit",
        title=f"{study.name!r} re-calibrated next to its orbit",
        verdict=verdict,
        summary=(verdict.sentence, *_orbit_sentences(study)),
        content={
            **OrbitRecord.of(study).numbers(),
            "rounds_ending": study.calibration.ending,
            "data": _data(study, log.input_kind),
            **estimate_numbers(study.estimate),
            "ratios_to_p1": ratios,
            "carried": str(log.added_mass),
            **known,
        },
        units={"free_run_rms_rad": "rad", "amplitudes_rad": "rad", "target_rad": "rad"},
    )


def _data(study: OrbitStudy, kind: InputKind) -> dict[str, str]:
    return {"name": study.name, "description": study.description, "input": str(kind)}


def _orbit_sentences(study: OrbitStudy) -> list[str]:
    """Say in plain words what was found, but for the verdict."""
    rounds, generic = study.calibration.rounds, study.errors["generic"]
    last, wanted = rounds[-1], rounds[-1].wanted
    better = generic / max(study.errors["re-calibrated"], 1e-12)
    recalibration = last.recalibration
    rejected = ", ".join(recalibration.rejected) or "none"
    begun = study.small_swings
    return [
        f"The hand was to swing {math.degrees(wanted):.2f}° and swung "
        + ", ".join(degrees_said(each.amplitude) for each in rounds)
        + f"° in {len(rounds)} rounds; {study.calibration.ending}.",
        f"Next to the orbit the re-calibrated model's free run is off by "
        f"{degrees_said(study.errors['re-calibrated'])}° rms, the model it began with by "
        f"{degrees_said(generic)}°: {better:.3g} times less.",
        f"Estimated by {recalibration.estimate.method}: {', '.join(recalibration.names)}; "
        f"terms that did not help on held-out data: {rejected}.",
        *estimate_sentences(study.estimate)[1:],
        *([] if begun is None else [f"What it began with: {estimate_verdict(begun).sentence}"]),
    ]


def degrees_said(angle: float) -> str:
    """Return an angle in degrees as it is said."""
    return "turned over" if math.isnan(angle) else f"{math.degrees(angle):.4g}"
