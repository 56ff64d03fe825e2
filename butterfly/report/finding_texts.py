"""What an estimate's verdict and its findings mean, in plain English: a sentence for each kind."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence

from butterfly.errors import UnusableError, listed
from butterfly.identification.derived_quantities import SYMBOLS
from butterfly.identification.diagnostics.findings import Ending, Finding, FindingKind
from butterfly.identification.diagnostics.unit_errors import unit_error_text
from butterfly.identification.estimate import OF_VERDICT, Estimate
from butterfly.identification.inference.agreement import Contrast
from butterfly.identification.inference.conditions import Condition
from butterfly.model.terms import TERMS
from butterfly.progress import stopped_text
from butterfly.report.agreement_texts import contrast_text
from butterfly.report.format import counted, fit_text, times_text
from butterfly.verdict import Level, Verdict

Values = Mapping[str, float]

REMEDY = (
    "say what the encoder reads where the hand hangs (zero: in the manifest, or --zero), or add a "
    "log that begins and ends at rest"
)
"""What helps where the encoder's zero is a guess."""

_LEAST_MASSES = 3  # of which one can be left out
_OF_MODEL = {
    FindingKind.FOLLOWED,
    FindingKind.MISFIT,
    FindingKind.NO_MISFIT,
    FindingKind.SCATTER,
    FindingKind.SEARCH_STOPPED,
    FindingKind.CLOCK,
    FindingKind.CLOCK_SET,
    FindingKind.OMEGA_SET,
    FindingKind.LIKE_CLOCK,
}
_NAMED = (
    *(FindingKind.CLOCK, FindingKind.CLOCK_SET, FindingKind.OMEGA_SET),
    FindingKind.LIKE_CLOCK,
)
"""Causes, by themselves."""


def estimate_sentences(estimate: Estimate) -> list[str]:
    """Say how far to trust an estimate: the verdict in two lines, then what else was found."""
    return [*estimate_verdict(estimate).lines, *estimate_notes(estimate)]


def estimate_notes(estimate: Estimate) -> list[str]:
    """Say what was found of an estimate besides what its verdict says."""
    others = (each for each in estimate.findings if not (each.forbids or each.kind in _OF_MODEL))
    return [
        *(
            finding_text(each, values_of(estimate))
            for each in others
            if not _outdone(each, estimate)
        ),
        *(contrast_text(each, estimate) for each in _contrasts(estimate)[1:]),
    ]


def _outdone(finding: Finding, estimate: Estimate) -> bool:
    """Whether terms that did not help the method are among those that the free runs lack."""
    missing = (each for each in estimate.findings if each.kind is FindingKind.MISSING_TERM)
    lacking = {name for each in missing for name in re.findall(r"\w+", each.parameters[0])}
    idle = finding.kind is FindingKind.NOT_HELPING
    return idle and not lacking.isdisjoint(finding.parameters)


def _contrasts(estimate: Estimate) -> list[Contrast]:
    """Return what follows a condition but for what scatters from log to log, which is said so."""
    scatters = {name for each in _scatters(estimate) for name in each.parameters}
    return [
        each
        for each in estimate.agreement
        if not (each.condition is Condition.LOG and each.parameter in scatters)
    ]


def _scatters(estimate: Estimate) -> list[Finding]:
    return [each for each in estimate.findings if each.kind is FindingKind.SCATTER]


def estimate_verdict(estimate: Estimate) -> Verdict:
    """Say what may be done with an estimate: how well values are known, how the model follows."""
    level = estimate.level
    values = values_sentence(estimate)
    if level is Level.WARNING:
        forbidding = (each for each in estimate.findings if each.forbids)
        why = [finding_text(each, values_of(estimate)) for each in forbidding]
        if estimate.ending is not Ending.CONVERGED:
            why.append("The fit did not settle.")
        values = " ".join(why)
    stopped = (each for each in estimate.findings if each.kind is FindingKind.SEARCH_STOPPED)
    lines = (values, model_sentence(estimate), *(finding_text(each, {}) for each in stopped))
    return Verdict(level, tuple(filter(None, lines)))


def require_possible(estimate: Estimate) -> Verdict:
    """Return the verdict on an estimate from which simulations or a model are to be made.

    Raises UnusableError if no joint has its values; the verdict is the message.
    """
    verdict = estimate_verdict(estimate)
    if any(each.impossible for each in estimate.findings):
        raise UnusableError(verdict.lines[0], verdict.reasons)
    return verdict


def values_of(estimate: Estimate) -> dict[str, float]:
    """Return the values that sentences speak of, by parameter."""
    return estimate.fixed | dict(zip(estimate.names, estimate.values.tolist(), strict=True))


def values_sentence(estimate: Estimate) -> str:
    """Say how well each value is known, by its 95 % interval; those of the scale first."""
    names = sorted(estimate.names, key=lambda name: name not in OF_VERDICT)
    names = [name for name in names if name not in estimate.unestimated]
    limits = zip(estimate.names, estimate.lower.tolist(), estimate.upper.tolist(), strict=True)
    zero = {name for name, lower, upper in limits if lower <= 0 <= upper}
    ratios = {name for name in names if estimate.ratios and not TERMS[name].of_gain}
    shown = {name: f"{name}/p1" if name in ratios else name for name in estimate.names}
    known = [name for name in names if name not in zero and math.isfinite(estimate.reach[name])]
    parts = [
        ", ".join(f"{shown[name]} within {_upwards(estimate.reach[name])}" for name in group)
        for group in (
            [name for name in known if name in OF_VERDICT],
            [name for name in known if name not in OF_VERDICT],
        )
    ]
    unknown = [shown[name] for name in names if name not in {*known, *zero}]
    parts += [f"how exact {_both(unknown)} {_is(unknown)} is not known"] if unknown else []
    missing = [name for name in estimate.unestimated if name in OF_VERDICT]
    parts += [f"{_both(missing)} {_is(missing)} not estimated"] if missing else []
    at_zero = [shown[name] for name in names if name in zero]
    parts += [f"{_both(at_zero)} not distinguishable from zero"] if at_zero else []
    return f"{'; '.join(filter(None, parts)) or 'all values known beforehand'}."


def model_sentence(estimate: Estimate) -> str:
    """Say how near the model follows, and what it misses; nothing where no log was simulated."""
    found = {each.kind: each for each in estimate.findings}
    causes = [each for kind in _NAMED for each in estimate.findings if each.kind is kind]
    named = [finding_text(each, values_of(estimate)) for each in causes]
    named += [_scatter(*scatters)] if (scatters := _scatters(estimate)) else []
    if FindingKind.FOLLOWED not in found:
        return " ".join(named)
    share = found[FindingKind.FOLLOWED].number
    if share is None or not math.isfinite(share):
        return "Some logs cannot be simulated with these values, or nothing moves in them."
    beyond, within = found.get(FindingKind.MISFIT), found.get(FindingKind.NO_MISFIT)
    missing, times = found.get(FindingKind.MISSING_TERM), (beyond or within)
    text = f"The model follows to {_percent(share)} of the motion"
    if times is not None and times.number is not None and math.isfinite(times.number):
        text += f", {times_text(times.number)} times what the sensors explain"
    if missing is not None:
        of_left = _percent(_number(missing))
        text += f"; it misses {missing.parameters[0]}, {of_left} of what is left"
    if beyond and not (missing or named or estimate.agreement):
        text += "; it misses something that looks like none of the terms on offer"
    first = [contrast_text(each, estimate) for each in _contrasts(estimate)[:1]]
    return " ".join([f"{text}.", *named, *first])


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
    return text.format(**fields)


def _number(finding: Finding) -> float:
    if finding.number is None:
        raise ValueError(f"the finding {finding.kind} has no number")
    return finding.number


def _poor_fit(finding: Finding, _: Values) -> str:
    cure = "Check units, signs and masses, and look at the residuals."
    if not math.isfinite(_number(finding)):
        return f"Simulated with these values, the model runs away. {cure}"
    return (
        "The model does not follow the logs, or their velocity: the median FIT is "
        f"{fit_text(_number(finding))} %. {cure}"
    )


def _contradicted(finding: Finding, _: Values) -> str:
    symbols = [SYMBOLS[name] for name in finding.parameters]
    return (
        "What is known of motor and hand does not go with these values: "
        f"{' and '.join(f'{each.symbol} ({each.meaning})' for each in symbols)} would be "
        f"{_number(finding):.1f} standard errors below 0. Check what was told, its units and the "
        "gear ratio."
    )


def _few_masses(finding: Finding, _: Values) -> str:
    why = "Without any one added mass the rest cannot determine the parameters"
    if _number(finding) < _LEAST_MASSES:
        why = "Fewer than three added masses"
    return f"{why}: the intervals could not be checked by leaving one out."


def _torque_driven(finding: Finding, values: Values) -> str:
    resistance = _number(finding)
    return (
        "The data look torque-driven: as a voltage-fed motor it would have a back-EMF constant "
        f"below {resistance * abs(values['p4']):.2g} V s/rad and a resistance below "
        f"{resistance:.2g} Ohm, since its back EMF alone would brake more than p2 does. Check the "
        "manifest's key input."
    )


def _not_estimated(finding: Finding, values: Values) -> str:
    gain = f", {values['p4']:.4g}" if "p4" in values else ""
    return (
        f"This method estimates neither {' nor '.join(finding.parameters)}: simulated with the p4 "
        f"that follows the logs best{gain}."
    )


def _missing_term(finding: Finding, _: Values) -> str:
    terms, *moved = finding.parameters
    moves = f" and moves {', '.join(moved)} by more than the intervals" if moved else ""
    them = "it" if re.fullmatch(r"\w+", terms) else "them"
    return (
        f"The model lacks {terms}, which helps to predict logs that were left out{moves}: it "
        f"explains {100 * _number(finding):.0f} % of the residuals. Add {them} to the terms."
    )


def _scatter(*findings: Finding) -> str:
    sizes = (f"{', '.join(each.parameters)} by {_percent(_number(each))}" for each in findings)
    return f"Scatter from log to log: {'; '.join(sizes)}."


_ONE_LOAD = "With one load, {} friction and Coulomb friction are one number: add a run with another"
_MORE_RUNS = {
    "load_friction": f"{_ONE_LOAD.format('load')} mass.",
    "motor_friction": f"{_ONE_LOAD.format('motor')} mass or command.",
    "bias": "In one direction, bias and Coulomb friction are one number: add a run the other way.",
    "stribeck": "At one speed, Stribeck and Coulomb friction are one number: add a slower run.",
    "drag": "At one speed, drag and viscous friction are one number: add a faster run.",
}
"""What would tell a term from others."""


def _percent(share: float) -> str:
    """Return a share in per cent, with two digits."""
    return f"{float(f'{100 * share:.2g}'):g} %"


def _upwards(share: float) -> str:
    """Return a share in per cent, with two digits, rounded up: a limit holds what it says."""
    percent = 100 * share * (1 - 1e-9)
    digit = 10.0 ** (math.floor(math.log10(percent)) - 1) if percent > 0 else 1.0
    return f"{math.ceil(percent / digit) * digit:.4g} %"


def _both(names: Sequence[str]) -> str:
    """Return names in a row."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def _is(names: Sequence[str]) -> str:
    return "is" if len(names) == 1 else "are"


_RESTS_ON = {
    "mass_scale": "the masses (1 % of all is 1 % of every value)",
    "arm": "the arm (1 % is up to 2 % of p1)",
    "input_scale": "the scale of the input (1 % of p4)",
    "angle_scale": "a centred encoder of right scale (1 % of p4)",
    "velocity_scale": "the scale of the velocity (1 % of p4)",
    "time_scale": "the clock (2 % of p1)",
}

_TEXTS: dict[FindingKind, str | Callable[[Finding, Values], str]] = {
    FindingKind.UNIT_ERROR: lambda finding, _: unit_error_text(finding),
    FindingKind.SUSPECTED: lambda finding, _: unit_error_text(finding),
    FindingKind.POOR_FIT: _poor_fit,
    FindingKind.NO_INERTIA: (
        "No joint has these values: {names} leaves an inertia of {number:.2g} kg m². Check units, "
        "signs and the added masses."
    ),
    FindingKind.NEGATIVE: (
        "No joint has these values: {names} cannot be negative. Check units, signs and stamps."
    ),
    FindingKind.EARLY: (
        "The delay is negative: the motion comes before its command. Check the stamps."
    ),
    FindingKind.NEGATIVE_GAIN: (
        "{names} is negative: a positive input turns the hand towards negative angles. If the "
        "angle or the input counts the other way, say so: sign: -1 in the manifest, or --units "
        "input=-1."
    ),
    FindingKind.TOLD_APART: (
        "{names} as it is told and as it follows from what is known of motor and hand lie "
        "{number:.1f} standard uncertainties apart: check both, and the gear ratio."
    ),
    FindingKind.CONTRADICTED: _contradicted,
    FindingKind.KNOWN_APART: (
        "The added masses contradict what was said to be known of {combined}: they would have it "
        "about {size:.2g} % {larger}. One of the two is wrong."
    ),
    FindingKind.PRIOR_APART: (
        "The logs contradict what was known of {names}, by {number:.1f} standard errors: one of "
        "the two is wrong, and the values lie between them."
    ),
    FindingKind.LEFT_OUT: (
        "{logs} {were} left out: the hand turns over, rests elsewhere or never settles, and the "
        "steady response to a sine says nothing there. The methods weak-form and output-error use "
        "them."
    ),
    FindingKind.REST_APART: (
        "The hand rests at angles that differ by {number:.2g} rad from mass to mass, as a constant "
        "torque makes it, and this method takes each for the encoder's zero: the methods "
        "harmonic-balance and output-error find the torque."
    ),
    FindingKind.ZERO_GUESSED: (
        "Where the hand hangs is a guess in {logs}, and this method takes it as given: "
        f"{REMEDY}. The method output-error fits it."
    ),
    FindingKind.UNPREDICTABLE: (
        "{logs} {were} left out: the hand passes the upright, where small causes tell, and no "
        "simulation from the start stays near. The method weak-form uses them."
    ),
    FindingKind.SCANNED: lambda finding, _: (
        f"{', '.join(finding.parameters)} is {_number(finding):.2g} "
        f"{TERMS[finding.parameters[0]].unit}, found by trying several; the intervals hold what "
        "others that predict as well would give."
    ),
    FindingKind.HELD: lambda finding, _: (
        f"{', '.join(finding.parameters)} is held at {_number(finding):.2g} "
        f"{TERMS[finding.parameters[0]].unit}: these logs hardly tell it, and others would do."
    ),
    FindingKind.NOT_HELPING: (
        "Not fitted, since {names} did not help to predict logs that were left out."
    ),
    FindingKind.INSEPARABLE: lambda finding, _: " ".join(
        [
            f"Not fitted, since these data cannot tell {', '.join(finding.parameters)} from the "
            "other terms.",
            *(_MORE_RUNS[name] for name in _MORE_RUNS if name in finding.parameters),
        ]
    ),
    FindingKind.SEARCH_STOPPED: lambda finding, _: stopped_text(
        _number(finding), finding.parameters
    ),
    FindingKind.OTHER_END: (
        "Started elsewhere the fit ends elsewhere, where it follows the logs less well "
        "({number:.3g} times the squared error): the best of the ends is given."
    ),
    FindingKind.COMBINATION: (
        "{combined} are known mainly in one combination (condition number {rounded:.0f}): add a "
        "run that tells them apart."
    ),
    FindingKind.ON_BOUND: "{names} ended on a bound: these data do not show any.",
    FindingKind.PULLED: (
        "{names} ended on a bound that the data would cross: the model misses something, or a "
        "sign, a mass or a stamp is wrong."
    ),
    FindingKind.FEW_MASSES: _few_masses,
    FindingKind.FEW_LOGS: (
        "With {used} the intervals come from stretches of time, and hold nothing of how the robot "
        "differs from run to run: record more."
    ),
    FindingKind.SCATTER: lambda finding, _: _scatter(finding),
    FindingKind.CLOCK: (
        "The inputs' sines run {percent:+.2g} % off their omega: the clock of the logs is wrong, "
        "or omega is. {names} differs by about twice that share: its interval holds both. Check "
        "clock and omega."
    ),
    FindingKind.CLOCK_SET: (
        "The inputs' sines run {percent:+.2g} % off their omega. The logs agree best if their "
        "clock is wrong by that: their stamps were corrected. Check the clock."
    ),
    FindingKind.OMEGA_SET: (
        "The inputs' sines run {percent:+.2g} % off their omega. The logs agree best if omega is "
        "wrong by that: it was corrected. Check omega."
    ),
    FindingKind.LIKE_CLOCK: (
        "These data cannot tell {names} from a clock that is {percent:+.2g} % off."
    ),
    FindingKind.SIGN_UNKNOWN: (
        "The sign of {names} cannot be seen in the motion: its size is given."
    ),
    FindingKind.TORQUE_DRIVEN: _torque_driven,
    FindingKind.NOT_ESTIMATED: _not_estimated,
    FindingKind.UNDRIVEN: (
        "Nothing drives the joint in these logs: {names} are not estimated. Add a log of the "
        "driven joint for them."
    ),
    FindingKind.NO_UNCERTAINTY: (
        "{number:.0f} resonance frequencies for {count} parameters leave no room for a statement "
        "of uncertainty."
    ),
    FindingKind.FOLLOWED: "The free runs leave {percent:.2g} % of the motion.",
    FindingKind.MISFIT: "They leave {number:.3g} times what encoder and noise explain.",
    FindingKind.NO_MISFIT: "Encoder and noise explain what they leave ({number:.2f} times).",
    FindingKind.MISSING_TERM: _missing_term,
    FindingKind.RESTS_ON: lambda finding, _: (
        f"All values rest on {_both([_RESTS_ON[name] for name in finding.parameters])}, which no "
        "log shows; a lag counts as delay, in small swings a spring as p3."
    ),
    FindingKind.ABSOLUTE: "Absolute values, the scale set by the known masses.",
    FindingKind.RATIOS: "Ratios to p1: no known mass was changed, and a controller needs no more.",
}
