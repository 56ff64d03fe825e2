"""The verdict on an estimate, and a sentence for each kind of finding."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence

from butterfly.errors import IdentifiabilityError, UnusableError, listed
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import over_segments
from butterfly.identification.physical import BETTER_METHOD
from butterfly.identification.repeatability import contradiction_text
from butterfly.identification.trust import Finding, FindingKind, Trust, or_nan
from butterfly.identification.unit_errors import unit_error_text
from butterfly.logs.units import Unread, taken_text
from butterfly.model.terms import OF_SCALE, TERMS
from butterfly.progress import stopped_text
from butterfly.report.format import counted, fit_text, limit_text, percent, times_text, upwards
from butterfly.report.parameter_table import contrast_text
from butterfly.verdict import Level, Verdict

Values = Mapping[str, float]

REMEDY = (
    "give the encoder's reading at the hanging rest position (zero: in the manifest, or --zero), "
    "or add a log that begins and ends at rest"
)
"""What helps where the encoder's zero is a guess."""

_LEAST_MASSES = 3  # for leave-one-mass-out
_UNEXPLAINED = 1.2  # times the sensor noise, below which nothing is left that a term may explain
_LOOK = "Look at the residuals of each log."
_IN_VERDICT = {
    *(FindingKind.FOLLOWED, FindingKind.MISFIT, FindingKind.NO_MISFIT, FindingKind.MISSING_TERM),
    *(FindingKind.NEIGHBOURS_STILL, FindingKind.NEIGHBOURS_CORRECTED),
}
_ASSUMED = {FindingKind.NEIGHBOURS_STILL, FindingKind.NEIGHBOURS_CORRECTED}  # end the first line


def estimate_sentences(estimate: Estimate) -> list[str]:
    """Return the verdict in two lines, then every finding, gravest first."""
    return [*estimate_verdict(estimate).lines, *estimate_notes(estimate)]


def estimate_notes(estimate: Estimate) -> list[str]:
    """Return what the verdict does not say, gravest first."""
    return [*grave_notes(estimate), *minor_notes(estimate)]


def grave_notes(estimate: Estimate) -> list[str]:
    """Return the sentences of findings that need care, gravest first."""
    scatters = [finding for finding in estimate.findings if finding.kind is FindingKind.SCATTER]
    quick = any(finding.kind is FindingKind.APPROXIMATE for finding in estimate.findings)
    return [
        *_texts_of(estimate, Level.CARE),
        *([_scatter(*scatters)] if scatters else []),
        # a fast look names no causes: what differs may be its own systematic error
        *(contrast_text(contrast, estimate) for contrast in estimate.agreement if not quick),
    ]


def minor_notes(estimate: Estimate) -> list[str]:
    """Return the sentences of findings that need nothing done."""
    return _texts_of(estimate, Level.NOTE)


def _texts_of(estimate: Estimate, level: Level) -> list[str]:
    kinds = {FindingKind.SCATTER, *_IN_VERDICT, *(finding.kind for finding in _doubts(estimate))}
    findings = [
        finding
        for finding in estimate.findings
        if finding.level is level
        and finding.kind not in kinds
        and not _contradicted_by_missing_term(finding, estimate)
    ]
    findings.sort(key=lambda finding: finding.gravity)
    return [finding_text(finding, values_of(estimate)) for finding in findings]


def _doubts(estimate: Estimate) -> list[Finding]:
    """Return the findings that begin a verdict of *use with care*."""
    doubts = (finding for finding in estimate.findings if finding.doubts)
    return sorted(doubts, key=lambda e: e.gravity) if estimate.level is Level.CARE else []


def _contradicted_by_missing_term(finding: Finding, estimate: Estimate) -> bool:
    """Whether a term that did not help the method is missing in the free runs."""
    missing = (other for other in estimate.findings if other.kind is FindingKind.MISSING_TERM)
    lacking = {name for other in missing for name in re.findall(r"\w+", other.parameters[0])}
    return finding.kind is FindingKind.NOT_HELPING and not lacking.isdisjoint(finding.parameters)


def estimate_verdict(estimate: Estimate) -> Verdict:
    """Return the verdict on an estimate: a line on its values, what closes open ones, its model."""
    forbidden = estimate.level is Level.WARNING
    findings = (
        [finding for finding in estimate.findings if finding.forbids]
        if forbidden
        else _doubts(estimate)
    )
    sentences = [finding_text(finding, values_of(estimate)) for finding in findings]
    if not forbidden:
        sentences.append(values_sentence(estimate))
        sentences += [finding_text(f, {}) for f in estimate.findings if f.kind in _ASSUMED]
    elif estimate.unsettled:
        sentences.append("The fit did not converge.")
    closing = "" if forbidden else closing_sentence(estimate)
    lines = " ".join(sentences), closing, model_sentence(estimate)
    return Verdict(estimate.level, tuple(filter(None, lines)))


def require_possible(estimate: Estimate) -> Verdict:
    """Return the verdict on an estimate; UnusableError if no joint has its values."""
    verdict = estimate_verdict(estimate)
    if any(finding.impossible for finding in estimate.findings):
        raise UnusableError(verdict.lines[0], verdict.reasons)
    return verdict


def require_values(estimate: Estimate, use: str) -> Verdict:
    """Return the verdict on an estimate for a use of all values.

    UnusableError if no joint has them, IdentifiabilityError if one is open.
    """
    verdict = require_possible(estimate)
    if names := estimate.open:
        are = "is" if len(names) == 1 else "are"
        raise IdentifiabilityError(
            f"{_both(names)} {are} open, and {use} needs {'it' if len(names) == 1 else 'both'}: "
            f"{_closing(names)}, or give what you know (--known {names[0]}=...)"
        )
    return verdict


def closing_sentence(estimate: Estimate) -> str:
    """Say which run gives what is open; nothing if all is known."""
    names = estimate.open
    if not names:
        return ""
    planned = "" if names == ("p4",) else " (`butterfly design` plans one)"
    return f"To know {_both(names)}, {_closing(names)}{planned}."


def _closing(names: Sequence[str]) -> str:
    return _both([f"add {TERMS[name].more_runs}" for name in names])


def values_of(estimate: Estimate) -> dict[str, float]:
    """Return the values by parameter, as sentences need them."""
    return estimate.fixed | estimate.named


def values_sentence(estimate: Estimate) -> str:
    """Say how well each value is known, by its 95 % interval; p1 and p4 first."""
    names = sorted(estimate.names, key=lambda name: name not in OF_SCALE)
    names = [name for name in names if name not in estimate.unestimated]
    opened = [row for row in estimate.table() if row.value is None]
    ratios = {name for name in names if estimate.ratios and not TERMS[name].of_gain}
    shown = {name: f"{name}/p1" if name in ratios else name for name in estimate.names}
    widths, trust = estimate.relative_half_widths, estimate.trust
    known = [name for name in names if trust[name].sized]
    parts = [
        ", ".join(f"{shown[name]} ±{upwards(widths[name])}" for name in group)
        for group in (
            [name for name in known if name in OF_SCALE],
            [name for name in known if name not in OF_SCALE],
        )
    ]
    unknown = [shown[name] for name in names if trust[name] is Trust.UNSURE]
    parts += [f"{_both(unknown)} without an interval"] if unknown else []
    missing = [name for name in estimate.unestimated if name in OF_SCALE]
    parts += [f"{_both(missing)} not estimated"] if missing else []
    at_zero = [shown[name] for name in names if trust[name] is Trust.ZERO]
    parts += [f"{_both(at_zero)} not significant"] if at_zero else []
    limits = [(shown[row.name], limit_text(or_nan(row.upper)), row.unit) for row in opened]
    limited = [f"{name} (at most {most} {unit})" for name, most, unit in limits]
    parts += [f"open: {', '.join(limited)}"] if limited else []
    return f"{'; '.join(filter(None, parts)) or 'all values were given'}."


def model_sentence(estimate: Estimate) -> str:
    """Say how large the error of the free runs is, and which term is missing."""
    findings = {finding.kind: finding for finding in estimate.findings}
    if FindingKind.FOLLOWED not in findings:
        return ""  # nothing was simulated
    share = findings[FindingKind.FOLLOWED].number
    if share is None or not math.isfinite(share):
        return "Model: some logs cannot be simulated with these values, or show no motion."
    beyond, within = findings.get(FindingKind.MISFIT), findings.get(FindingKind.NO_MISFIT)
    missing, times = findings.get(FindingKind.MISSING_TERM), (beyond or within)
    text = f"Model: error {percent(share)} of the motion{over_segments(estimate.horizon)}"
    if times is not None and times.number is not None and math.isfinite(times.number):
        text += f", {times_text(times.number)} times the sensor noise"
    if missing is not None:
        share_of_error = percent(_number(missing))
        text += f"; missing term: {missing.parameters[0]} ({share_of_error} of the residual)"
    elif _is_unexplained(beyond, estimate) and not (_doubts(estimate) or grave_notes(estimate)):
        text += "; none of the optional terms explains it"
    return f"{text}."


def _is_unexplained(misfit: Finding | None, estimate: Estimate) -> bool:
    """Whether clearly more than sensor noise is left, about values that can be used."""
    least = _UNEXPLAINED if estimate.level.usable else math.inf
    return misfit is not None and _number(misfit) >= least


def finding_text(finding: Finding, values: Values) -> str:
    """Return the sentence that says what one finding means: its names, logs, and its number."""
    text = _TEXTS[finding.kind]
    if not isinstance(text, str):
        return text(finding, values)
    names, number, logs = finding.parameters, finding.number, finding.logs
    fields: dict[str, object] = {
        "names": ", ".join(names),
        "count": len(names),
        "combined": " and ".join(names),
        "logs": listed(logs),
        "were": "was" if len(logs) == 1 else "were",
    }
    if number is not None:
        fields |= {"number": number, "percent": 100 * number, "used": counted(number, "log")}
        fields |= {"rounded": float(f"{number:.2g}"), "size": abs(100 * number)}
        fields["larger"] = "larger" if number > 0 else "smaller"
        fields["faster"] = "faster" if number > 0 else "slower"
    return text.format(**fields)


def _number(finding: Finding) -> float:
    if finding.number is None:
        raise ValueError(f"the finding {finding.kind} has no number")
    return finding.number


def _poor_fit(finding: Finding, _: Values) -> str:
    cure = " ".join(map(BETTER_METHOD.format, finding.parameters)) or _LOOK
    if not math.isfinite(_number(finding)):
        return f"The simulation with these values diverges. {cure}"
    fit = fit_text(_number(finding))
    return (
        f"The model does not follow the logs or their velocity: median FIT {fit} % beyond the "
        f"sensor noise. {cure}"
    )


def _prior_conflict(finding: Finding, _: Values) -> str:
    name, *assumed = finding.parameters
    far = f"by {_number(finding):.1f} standard errors"
    if not assumed:
        return (
            f"The logs contradict the given {name} {far}. One of the two is wrong; the estimate is "
            "a compromise."
        )
    return (
        f"The logs contradict the assumed {name}, {assumed[0]} {TERMS[name].unit}, {far}; the "
        f"estimate is a compromise. Give the {name} if you know it."
    )


def _motor_conflict(finding: Finding, _: Values) -> str:
    name, motor = finding.parameters
    return (
        f"The logs contradict the {name} of {motor} by {_number(finding):.1f} standard errors: "
        "yours is another motor, or is driven otherwise. The estimate is a compromise; identify "
        f"without it, or give your own {name}."
    )


def _few_masses(finding: Finding, _: Values) -> str:
    if _number(finding) < _LEAST_MASSES:
        return "Fewer than three added masses: no leave-one-mass-out check of the intervals."
    return (
        "Without any one added mass the others do not determine the parameters: no "
        "leave-one-mass-out check of the intervals."
    )


def _torque_driven(finding: Finding, values: Values) -> str:
    resistance = _number(finding)
    return (
        "The input is declared as a voltage but looks like a torque: p2 is too small for a motor's "
        f"back EMF, unless its constant is below {resistance * abs(values['p4']):.2g} V s/rad and "
        f"the resistance below {resistance:.2g} Ohm. Check the manifest's key input."
    )


def _unit_unread(taken: str, unit: str, place: str, kind: str = "") -> str:
    unread = Unread(taken, unit, place, kind)
    return f"I{unread.text[1:]}. {unread.cure}"


def _not_estimated(finding: Finding, values: Values) -> str:
    gain = f" p4 = {values['p4']:.4g}, which fits the logs best" if "p4" in values else ""
    used = f"; simulations use{gain}" if gain else ""
    return f"This method does not estimate {' or '.join(finding.parameters)}{used}."


def _missing_term(finding: Finding, _: Values) -> str:
    terms, *moved = finding.parameters
    moves = f" and shifts {', '.join(moved)} by more than the intervals" if moved else ""
    them = "it" if re.fullmatch(r"\w+", terms) else "them"
    return (
        f"The model lacks {terms}, which improves the prediction of held-out logs{moves} and "
        f"explains {100 * _number(finding):.0f} % of the residual. Add {them} to --terms."
    )


def _like_scale(finding: Finding) -> str:
    term, *scales = finding.parameters
    either = " or ".join(_RESTS_ON[name].partition(" (")[0] for name in scales)
    return (
        f"These data cannot distinguish {term} from an error of {either} that shifts p1 by "
        f"{percent(_number(finding))}: the intervals include both. Check "
        f"{'it' if len(scales) == 1 else 'them'}."
    )


def _scatter(*findings: Finding) -> str:
    sizes = (
        f"{', '.join(finding.parameters)} by {percent(_number(finding))}" for finding in findings
    )
    return f"Scatter between logs: {'; '.join(sizes)}."


def _both(names: Sequence[str]) -> str:
    """Return names in a row."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


_RESTS_ON = {
    "mass_scale": "the masses (1 % shifts every value by 1 %)",
    "arm": "the arm (1 % shifts p1 by up to 2 %)",
    "gravity_scale": "the level of the bench (1° shifts p1 and p4 by 0.015 %, 8° by 1 %)",
    "input_scale": "the input scale (1 % shifts p4 by 1 %)",
    "angle_scale": "the encoder scale and centring (1 %, or 0.5° off centre, shifts p4 by 1 %)",
    "velocity_scale": "the velocity scale (1 % shifts p4 by 1 %)",
    "time_scale": "the clock (1 % shifts p1 by 2 %)",
    "loop_clock": "the clock of the loop (1 ms is assumed, faster ones are covered)",
    "lag": (
        "a filter of the logger (10 ms shifts the delay by 10 ms, and at 10 rad/s p4 by 0.5 %) or "
        "the hold between samples (it shifts the delay alone)"
    ),
}

_TEXTS: dict[FindingKind, str | Callable[[Finding, Values], str]] = {
    FindingKind.UNIT_ERROR: lambda finding, _: unit_error_text(finding),
    FindingKind.SUSPECTED: lambda finding, _: unit_error_text(finding),
    FindingKind.ASKED: lambda finding, _: unit_error_text(finding),
    FindingKind.UNREPEATED: lambda finding, _: contradiction_text(finding),
    FindingKind.POOR_FIT: _poor_fit,
    FindingKind.NO_INERTIA: (
        "No joint has these values: {names} gives an inertia of {number:.2g} kg m². "
        "`butterfly inspect` shows which parameters these logs determine."
    ),
    FindingKind.NEGATIVE: (
        "No joint has these values: {names} cannot be negative. Something besides the recorded "
        f"input drives the joint, or the model lacks a term. {_LOOK}"
    ),
    FindingKind.EARLY: (
        "The delay is negative: the motion precedes its input. Check the timestamps."
    ),
    FindingKind.NEGATIVE_GAIN: (
        "{names} is negative: a positive input moves the joint in the negative direction. If angle "
        "or input counts the other way, set sign: -1 in the manifest, or negate its unit "
        "(as in --units input=-V)."
    ),
    FindingKind.SOURCES_CONFLICT: (
        "The given {names} and its value from the given motor and body data differ by {number:.1f} "
        "standard uncertainties. Check both, and the gear ratio."
    ),
    FindingKind.CONTRADICTED: (
        "The given motor and body data contradict these values: {combined} would be {number:.1f} "
        "standard errors below 0. Check the given values and the gear ratio."
    ),
    FindingKind.KNOWN_CONFLICT: (
        "The added masses contradict the given {combined}: they suggest values about {size:.2g} % "
        "{larger}. One of the two is wrong."
    ),
    FindingKind.PRIOR_CONFLICT: _prior_conflict,
    FindingKind.MOTOR_CONFLICT: _motor_conflict,
    FindingKind.LEFT_OUT: (
        "{logs} {were} excluded: the joint turns over, rests elsewhere or never settles, and has "
        "no steady response to a sine. The methods weak-form and output-error use such logs."
    ),
    FindingKind.REST_DIFFERS: (
        "The rest angles differ by {number:.2g} rad from mass to mass, as with a constant torque, "
        "but this method takes each as the encoder zero. The method output-error fits the torque."
    ),
    FindingKind.ZERO_GUESSED: (
        "The encoder zero is a guess in {logs}, and this method does not fit it: "
        f"{REMEDY}. The method output-error fits it."
    ),
    FindingKind.APPROXIMATE: (
        "This method is a fast look: its intervals do not include its systematic error. "
        "Those of output-error do."
    ),
    FindingKind.UNPREDICTABLE: (
        "{logs} {were} excluded: near the upright position the motion is too sensitive for a "
        "free run to follow. The method weak-form uses such logs."
    ),
    FindingKind.NOT_HELPING: ("Tested and left out (no better prediction): {names}."),
    FindingKind.INSEPARABLE: lambda finding, _: " ".join(
        [
            f"Not fitted: {', '.join(finding.parameters)}. Not identifiable from these data.",
            *(
                row.more_runs
                for row in TERMS.values()
                if row.more_runs and row.name in finding.parameters
            ),
        ]
    ),
    FindingKind.SEARCH_STOPPED: lambda finding, _: stopped_text(
        math.inf if finding.number is None else finding.number, finding.parameters
    ),
    FindingKind.OTHER_END: (
        "Another start led to a worse minimum ({number:.3g} times the squared error); the best fit "
        "is shown."
    ),
    FindingKind.COMBINATION: (
        "These logs hardly separate {combined} (condition number {rounded:.0f}): add a run that "
        "separates them."
    ),
    FindingKind.ON_BOUND: "{names} at the bound: these data show no such effect.",
    FindingKind.PULLED: (
        "{names} stopped at the bound, beyond which the logs would fit better: the model lacks a "
        f"similar effect. {_LOOK}"
    ),
    FindingKind.FEW_MASSES: _few_masses,
    FindingKind.FEW_LOGS: (
        "With {used} the intervals do not cover scatter between runs and may be too narrow: "
        "record more runs."
    ),
    FindingKind.SCATTER: lambda finding, _: _scatter(finding),
    FindingKind.CLOCK: (
        "The recorded sines are {size:.2g} % {faster} than the given omega: the clock or omega is "
        "wrong. This shifts {names} by about twice that; the intervals cover both. Check clock and "
        "omega."
    ),
    FindingKind.CLOCK_SET: (
        "The recorded sines are {size:.2g} % {faster} than the given omega. A clock error explains "
        "this best: the timestamps were corrected. Check the clock."
    ),
    FindingKind.OMEGA_SET: (
        "The recorded sines are {size:.2g} % {faster} than the given omega. A wrong omega explains "
        "this best: it was corrected. Check omega."
    ),
    FindingKind.STRAIGHT: (
        "The input between samples is not specified: straight lines fit the logs better than held "
        "values, and were used. If that is right, set intersample: first_order_hold in the "
        "manifest."
    ),
    FindingKind.LIKE_SCALE: lambda finding, _: _like_scale(finding),
    FindingKind.LIKE_TERM: lambda finding, _: (
        f"{finding.parameters[0]} is not fitted and would move {_both(finding.parameters[1:])} by "
        f"{percent(_number(finding))}: these data cannot rule it out, and the intervals include "
        "it. Add larger swings, or fit it (--terms)."
    ),
    FindingKind.SIGN_UNKNOWN: (
        "The sign of {names} is not identifiable from the motion; the magnitude is shown."
    ),
    FindingKind.OFF_CENTRE: lambda finding, _: (
        "The error repeats with the angle, as it does for an encoder mounted off centre, which "
        f"reads up to {math.degrees(_number(finding)):.2g}° too much or too little. This scales "
        "the angle, and p4 with it; the intervals include it. Centre the encoder, or check it "
        "against known angles."
    ),
    FindingKind.TORQUE_DRIVEN: _torque_driven,
    FindingKind.NOT_ESTIMATED: _not_estimated,
    FindingKind.UNDRIVEN: (
        "No input in these logs: {names} cannot be estimated. Add a log with input."
    ),
    FindingKind.NO_UNCERTAINTY: (
        "{number:.0f} resonance frequencies for {count} parameters: too few for intervals."
    ),
    FindingKind.FOLLOWED: "The error of the free runs is {percent:.2g} % of the motion.",
    FindingKind.MISFIT: "The error is {number:.3g} times the sensor noise.",
    FindingKind.NO_MISFIT: "Sensor noise explains the error ({number:.2f} times).",
    FindingKind.MISSING_TERM: _missing_term,
    FindingKind.UNIT_UNREAD: lambda finding, _: _unit_unread(*finding.parameters[1:]),
    FindingKind.UNIT_ASSUMED: lambda finding, _: f"I{taken_text(finding.parameters[1])[1:]}.",
    FindingKind.HELD: (
        "The input between samples is not specified: it was held, as straight lines fit the logs "
        "no better. With straight lines the "
        "{names} "
        "would be half a sample longer."
    ),
    FindingKind.RESTS_ON: lambda finding, _: (
        "The logs cannot show errors of "
        f"{_both([_RESTS_ON[name] for name in finding.parameters])}. At small "
        "swings a spring looks like p3."
    ),
    FindingKind.PLANT: (
        "All values depend on the simulator, too: finer steps shift "
        "{names} "
        "by "
        "{percent:.1g} "
        "%, and the others by a smaller part of their intervals, which include this."
    ),
    FindingKind.LOGS_LOST: (
        "The model does not follow all of {used} (FIT below 50 %: {logs}): look at these, or "
        "leave them out."
    ),
    FindingKind.NEIGHBOURS_UNSEEN: (
        "Nothing shows whether {names} stood still: motors that give way by 10 to 40 mrad move p1 "
        "by 1 to 3 %. Record their positions too, or say that they are clamped (--clamped)."
    ),
    FindingKind.NEIGHBOURS_MOVED: (
        "{names} moved by up to {number:.2g} rad (or m), which is not corrected: hold them, or "
        "give p4 (their torque is then subtracted from the input)."
    ),
    FindingKind.NEIGHBOURS_STILL: "Clamped, as you say: {names}.",
    FindingKind.NEIGHBOURS_CORRECTED: (
        "The motion of "
        "{names} "
        "accounts for "
        "{percent:.2g} "
        "% of the drive's torque; this is corrected."
    ),
    FindingKind.ABSOLUTE: "Absolute values, scaled by the known masses.",
    FindingKind.RATIOS: (
        "No known mass was added, so values are ratios to p1: enough to design a controller."
    ),
}
