"""`compare` and `changed`: simulators with logs, and one identification with another."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from butterfly.api.identification import Identification
from butterfly.api.sources import Data, Named
from butterfly.api.verbs import Method, estimated, numbers_of_logs, require_identification
from butterfly.arguments import checked
from butterfly.comparison.answers import Change, ParameterChange, change
from butterfly.errors import InputError, listed
from butterfly.files import finite
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.residuals import Residuals, residual_units, residuals_of
from butterfly.identification.trust import unit_of
from butterfly.logs.log import InputKind
from butterfly.model.parameters import JointKind
from butterfly.model.terms import TERMS
from butterfly.progress import Track, untracked
from butterfly.report.finding_texts import estimate_verdict, require_values
from butterfly.report.format import counted, is_relative, label_of, percent, with_error
from butterfly.report.inspection import (
    RESIDUAL_CAPTION,
    RESIDUAL_COLUMNS,
    Row,
    about_log,
    fit_facts,
    of_logs,
    residual_row,
)
from butterfly.report.numbers import residual_numbers, rests_on
from butterfly.report.page import Fact, PageTable, views
from butterfly.result import Answer
from butterfly.verdict import Level

if TYPE_CHECKING:
    from butterfly.comparison.three_way import ThreeWay

_STEPS = "MuJoCo takes the steps of `run`; `export` reports the error of its file in its own."


@checked
def compare(
    data: Data,
    method: Method | None = None,
    *,
    logs: Sequence[int] | None = None,
    hand_mass: float | None = None,
    holdout: Sequence[str] = (),
    track: Track = untracked,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Answer:
    """Simulate logs in MuJoCo and with the grey-box model, both with the identified parameters.

    Parameters
    ----------
    data, method, logs, holdout, options
        As in `residual`.
    hand_mass
        Mass of the moving body in MuJoCo, in kg; the motion does not depend on it. Default: chosen.
    track
        Progress callback.
    """
    from butterfly.comparison.three_way import compare_three  # noqa: PLC0415 - slow to import

    if not isinstance(hand_mass, Real | None):
        raise InputError("compare", "hand_mass", hand_mass, "a number in kg")
    whole, estimator, estimate = estimated(data, method, options, holdout)
    require_values(estimate, "a simulation in MuJoCo")
    numbers = numbers_of_logs("compare", logs, len(whole.logs))
    compared = compare_three(whole, estimate, numbers, mass=hand_mass, track=track)
    return comparison_answer(whole, estimator, compared, residuals_of(whole, estimate), estimate)


def comparison_answer(
    data: DataSet,
    estimator: Estimator | None,
    compared: Sequence[ThreeWay],
    residuals: Residuals,
    estimate: Estimate,
) -> Answer:
    """Tabulate MuJoCo, the grey-box model and the logs, given the same input."""
    from butterfly.report.log_figures import residual_sentences  # noqa: PLC0415 - slow to import
    from butterfly.report.three_way_page import with_courses  # noqa: PLC0415 - slow to import

    verdict, way = estimate_verdict(estimate), data.joint.way
    title, column = (
        f"MuJoCo, grey-box model and logs of {data.name!r}",
        f"simulators apart in {way}",
    )
    judged = {log.name: log for log in residuals.logs}
    log_residuals = tuple(judged[one.log.name] for one in compared)
    fits = {name: f"FIT {name} in %" for name in compared[0].fits}
    responses = [*_responses(compared[0])]
    rows = finite(
        [
            {
                **about_log(one.log),
                **{fits[name]: fit for name, fit in one.fits.items()},
                column: one.difference,
                **_responses(one),
                **residual_row(log),
            }
            for one, log in zip(compared, log_residuals, strict=True)
        ]
    )
    errors: dict[str, Callable[[Row], object]] = {"log": label_of}
    errors |= {name: _signed(name) for name in responses}
    tables = [
        of_logs(title, rows, *fits.values(), column),
        PageTable.of("Amplitude and phase", rows, errors, detail=True),
        of_logs("Residuals", rows, *RESIDUAL_COLUMNS, caption=RESIDUAL_CAPTION),
    ]
    difference = f"{max(one.difference for one in compared):.2g} {way}"
    facts = [
        *fit_facts(rows, fits["MuJoCo"], "of MuJoCo"),
        *fit_facts(rows, fits["grey box"], "of the grey box"),
        Fact("MuJoCo − grey box", difference, "largest difference"),
        Fact("logs compared", str(len(rows)), f"of {len(data.logs)}"),
    ]
    return Answer(
        kind="comparison",
        title=title,
        summary=(
            *verdict.after(_comparison_sentence(compared)),
            _STEPS,
            *residual_sentences(replace(residuals, logs=log_residuals)),
        ),
        judged=verdict,
        content={
            **rests_on(data, estimate, estimator),
            "rows": rows,
            "residuals": residual_numbers(residuals, estimate),
            **views(tables, facts, "fits", "frequency"),
        },
        units=residual_units(data.joint),
        live=partial(with_courses, compared, log_residuals),
    )


def _responses(comparison: ThreeWay) -> dict[str, float]:
    """Return how the steady responses of the simulators differ from that of the log."""
    cells = {}
    for name in comparison.fits:
        gain = comparison.gains.get(name, complex(np.nan, np.nan))
        cells[f"amplitude error {name} in %"] = float(100 * (np.abs(gain) - 1))
        cells[f"phase error {name} in °"] = float(np.degrees(np.angle(gain)))
    return cells


def _signed(name: str) -> Callable[[Row], str]:
    """Return the cell of an error, with its sign; a dash for none."""
    return lambda row: "–" if row[name] is None else f"{row[name]:+.2g}"


def _comparison_sentence(compared: Sequence[ThreeWay]) -> str:
    """State how far the simulators are from each other, and the fit of both."""
    difference = max(comparison.difference for comparison in compared)
    way = compared[0].log.added_mass.joint.way
    fits = {
        key: np.array([comparison.fits[key] for comparison in compared]) for key in compared[0].fits
    }
    medians = ", ".join(
        f"{key} {np.median(fit):.2f} % (worst {fit.min():.2f} %)" for key, fit in fits.items()
    )
    return (
        f"MuJoCo and grey box differ by at most {difference:.2g} {way}, with the same parameters "
        f"and recorded input of {counted(len(compared), 'log')}. Median FIT: {medians}."
    )


_PLACES = ("the first", "the second")


_LISTED = 4  # parameters whose detectable change is named


@checked
def changed(before: Identification | Named, after: Identification | Named) -> Answer:
    """Test whether a joint has changed between two identifications from independent logs.

    Parameters
    ----------
    before, after
        Each an `Identification` or its saved file.
    """
    one, other = (require_identification(result, "changed") for result in (before, after))
    return change_answer(one, other)


def change_answer(one: Identification, other: Identification) -> Answer:
    """Tell whether the parameters of a joint have changed; InputError if that makes no sense."""
    for name in ("input", "joint"):
        first, second = (result.origin.get(name, JointKind.HINGE) for result in (one, other))
        if first != second:
            raise InputError("changed", name, second, f"{first}, as in the first result")
    comparison = change(one.estimate, other.estimate)
    kind = InputKind(one.origin["input"])
    joint = JointKind(one.origin.get("joint", JointKind.HINGE))
    units = {
        parameter.name: unit_of(parameter.name, kind, joint) for parameter in comparison.parameters
    }
    rows = finite(
        [
            {
                "parameter": parameter.name,
                "before": parameter.before,
                "after": parameter.after,
                "change in %": 100 * parameter.relative,
                "lower": parameter.interval[0],
                "upper": parameter.interval[1],
                "standard_error": parameter.error,
                "probability": parameter.corrected,
                "detectable": parameter.detectable,
                "changed": parameter.changed,
                "unit": units[parameter.name],
            }
            for parameter in comparison.parameters
        ]
    )
    title = f"{other.origin['name']!r} after {one.origin['name']!r}"
    return Answer(
        kind="change",
        title=title,
        summary=(
            _reserve(one, other)
            + _answer(comparison, {row["parameter"]: row["unit"] for row in rows}),
            *_warnings(one, other),
            *_untested(comparison),
        ),
        content={
            "identifications": [
                {
                    **{key: result.origin[key] for key in ("name", "input", "logs")},
                    "estimator": result.estimator,
                    **result.judged.numbers(),
                }
                for result in (one, other)
            ],
            "rows": rows,
            **views([PageTable.of(title, [*map(_shown, rows)])], _facts(rows), "changes"),
        },
    )


def _facts(rows: Sequence[Mapping[str, Any]]) -> list[Fact]:
    """Return the numbers that matter most."""
    moved = [row["parameter"] for row in rows if row["changed"]]
    sizes = {row["parameter"]: row for row in rows if is_relative(row)}
    seen = {name: row["detectable"] / abs(row["before"]) for name, row in sizes.items()}
    least = min(seen, key=lambda name: seen[name], default="")
    moves = {name: abs(row["change in %"]) for name, row in sizes.items()}
    largest = max(moved, key=lambda name: moves.get(name, 0), default="")
    facts = [Fact("changed", f"{len(moved)} of {len(rows)}", ", ".join(moved) or "none")]
    if largest in sizes:
        facts.append(Fact("largest change", f"{sizes[largest]['change in %']:+.2g} %", largest))
    if least:
        facts.append(Fact("detectable change", percent(seen[least]), f"in {least}, the least"))
    return facts


def _shown(row: Mapping[str, Any]) -> dict[str, str]:
    before, after, error = (row[key] for key in ("before", "after", "standard_error"))
    relative = is_relative(row)
    size, unit = (abs(before) / 100, " %") if relative else (1.0, "")
    # decimals that show the first digit of the error
    digits = f".{max(-math.floor(math.log10(error / size)), 0)}f" if relative else ".2g"
    moved, reach = (after - before) / size, (row["upper"] - row["lower"]) / 2 / size
    seen = row["detectable"] / size
    return {
        "": row["parameter"],
        "first": with_error(before, error),
        "second": with_error(after, error),
        "change, 95 %": f"{moved:+{digits}} ± {reach:{digits}}{unit}",
        "p-value": f"{row['probability']:.2g}",
        "detectable": percent(seen / 100) if relative else f"{seen:.2g}",
    }


def _answer(comparison: Change, units: Mapping[str, str]) -> str:
    """State which parameters have changed."""
    if comparison.changed:
        moved = [_moved(parameter, units[parameter.name]) for parameter in comparison.changed]
        if len(comparison.changed) < len(comparison.parameters):
            moved.append("No other change is significant.")
        return " ".join(moved)
    if not comparison.jointly_changed:
        return f"No significant change.{_seen(comparison)}"
    together = (
        "The joint has changed: the parameters together differ significantly (p = "
        f"{comparison.joint_probability:.1g}), though no single one does."
    )
    if comparison.ratio is None or not math.isfinite(comparison.ratio.relative):
        return together
    return (
        f"{together} The clearest change: the ratio {comparison.ratio.name} "
        f"{_by(comparison.ratio)}."
    )


def _moved(parameter: ParameterChange, unit: str) -> str:
    """State the change of a parameter, and its values before and after."""
    name = TERMS[parameter.name].called or parameter.name
    one, other = (
        with_error(value, parameter.error) for value in (parameter.before, parameter.after)
    )
    return f"{name[0].upper()}{name[1:]} {_by(parameter)} (from {one} to {other} {unit})."


def _by(parameter: ParameterChange) -> str:
    """State the change in per cent, if it is defined."""
    if not math.isfinite(parameter.relative):
        return "has changed"
    grown = parameter.difference * parameter.before > 0
    return f"has {'increased' if grown else 'decreased'} by {percent(abs(parameter.relative))}"


def _seen(comparison: Change) -> str:
    """State the smallest detectable changes."""
    sizes = sorted(
        (parameter.detectable / abs(parameter.before), parameter.name)
        for parameter in comparison.parameters
        if math.isfinite(parameter.relative)
    )
    if not sizes:
        return ""
    parts = [f"{percent(size)} in {name}" for size, name in sizes[:_LISTED]]
    return f" Detectable with 80 % power: {listed(parts)}."


def _untested(comparison: Change) -> list[str]:
    """Name the parameters that were not compared, and why."""
    sentences = [f"Not compared: {name} ({why})." for name, why in comparison.untested.items()]
    if math.isnan(comparison.joint_probability) and len(comparison.parameters) > 1:
        why = "too few logs to estimate the correlation of their errors"
        sentences.append(f"No joint test of all parameters: {why}.")
    return sentences


def _reserve(*both: Identification) -> str:
    """Return a warning about results that must not be used; empty if there are none."""
    pairs = zip(_PLACES, both, strict=True)
    places = [place for place, result in pairs if result.judged.level is Level.WARNING]
    return f"Do not rely on this: do not use {listed(places)} result. " if places else ""


def _warnings(*both: Identification) -> list[str]:
    """Name other possible causes of a difference."""
    sentences = [
        f"Verdict on {place} result: {result.judged.lines[0]}"
        for place, result in zip(_PLACES, both, strict=True)
        if result.judged.level is not Level.GOOD
    ]
    one, other = (result.estimate for result in both)
    if both[0].estimator != both[1].estimator:
        names = ", ".join(result.estimator for result in both)
        sentences.append(f"Different estimators ({names}) may cause a difference.")
    terms = sorted(set(one.names) ^ set(other.names))
    if terms:
        sentences.append(
            f"Only one result fits {listed(terms)}; this may shift the other parameters. Identify "
            "both with the same --terms."
        )
    in_both = one.fixed.keys() & other.fixed.keys()
    fixed = sorted(name for name in in_both if one.fixed[name] != other.fixed[name])
    if fixed:
        sentences.append(
            f"Fixed at different values: {listed(fixed)}. This may shift the other parameters."
        )
    shared = _files(both[0]) & _files(both[1])
    if shared:
        sentences.append(
            f"{len(shared)} logs are in both results. The test assumes independent logs, so it "
            "detects fewer changes."
        )
    return sentences


def _files(result: Identification) -> set[Path]:
    """Return the files of its logs, as far as they are known."""
    manifest: dict[str, Any] | None = result.origin["manifest"]
    if manifest is None or manifest["root"] is None:
        return set()
    return {Path(manifest["root"]) / entry["file"] for entry in manifest["logs"]}
