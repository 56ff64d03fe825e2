"""What an estimate's verdict and its findings mean, in plain English: a sentence for each kind."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence

from butterfly.errors import UnusableError
from butterfly.identification.derived_quantities import SYMBOLS
from butterfly.identification.diagnostics.findings import (
    Ending,
    Finding,
    FindingKind,
    grade,
    is_impossible,
)
from butterfly.identification.diagnostics.unit_errors import listed, unit_error_text
from butterfly.identification.estimate import Estimate
from butterfly.model.terms import TERMS
from butterfly.report.format import counted, fit_text
from butterfly.verdict import Level, Verdict

Values = Mapping[str, float]

REMEDY = (
    "say what the encoder reads where the hand hangs (zero: in the manifest, or --zero), or add a "
    "log that begins and ends at rest"
)
"""What helps where the encoder's zero is a guess."""

_LEAST_MASSES = 3  # of which one can be left out
_PRECISION = {FindingKind.PRECISE, FindingKind.ROUGH, FindingKind.NOT_FROM_ZERO}  # in one sentence


def estimate_sentences(estimate: Estimate) -> list[str]:
    """Say how far to trust an estimate: the verdict, how well each value is known, the rest."""
    return sentences_of(estimate.ending, estimate.findings, values_of(estimate))


def estimate_verdict(estimate: Estimate) -> Verdict:
    """Say what may be done with an estimate, and why not more."""
    return _verdict(estimate.ending, estimate.findings, values_of(estimate))


def require_possible(estimate: Estimate) -> Verdict:
    """Return the verdict on an estimate from which simulations or a model are to be made.

    Raises UnusableError if no joint has its values; the verdict is the message.
    """
    verdict = estimate_verdict(estimate)
    if any(is_impossible(each) for each in estimate.reasons):
        raise UnusableError(verdict.sentence, verdict.reasons)
    return verdict


def values_of(estimate: Estimate) -> dict[str, float]:
    """Return the values that sentences speak of, by parameter."""
    return estimate.fixed | dict(zip(estimate.names, estimate.values.tolist(), strict=True))


def sentences_of(ending: Ending, findings: Sequence[Finding], values: Values) -> list[str]:
    """Say what an ending and findings about parameters mean: verdict, precision, the rest.

    Of values that are not to be used nothing is called known.
    """
    precision = [_text(each, values) for each in findings if each.kind in _PRECISION]
    level, reasons = grade(ending, findings)
    others = [each for each in findings if each.kind not in _PRECISION and each not in reasons]
    known = ["; ".join(precision) + "."] if precision and level.usable else []
    return [
        _verdict(ending, findings, values).sentence,
        *known,
        *(finding_text(each, values) for each in others),
    ]


def finding_text(finding: Finding, values: Values) -> str:
    """Return the sentence that says what one finding means."""
    text = _text(finding, values)
    return f"{text}." if finding.kind in _PRECISION else text


def _verdict(ending: Ending, findings: Sequence[Finding], values: Values) -> Verdict:
    level, found = grade(ending, findings)
    reasons = tuple(finding_text(each, values) for each in found)
    if not reasons and level is not Level.GOOD:
        reasons = ("The estimation did not settle.",)
    return Verdict(level, reasons)


def _text(finding: Finding, values: Values) -> str:
    """Fill in the text of a finding's kind: names, logs, and its number in several forms."""
    text = _TEXTS[finding.kind]
    if not isinstance(text, str):
        return text(finding, values)
    names, number, logs = finding.parameters, finding.number, finding.logs
    fields: dict[str, object] = {
        "names": ", ".join(names),
        "count": len(names),
        "combined": " and ".join(names),
        "first": names[0] if names else "",
        "others": ", ".join(names[1:]),
        "logs": listed(logs),
        "are": "is" if len(logs) == 1 else "are",
        "were": "was" if len(logs) == 1 else "were",
    }
    if number is not None:
        fields |= {"number": number, "percent": 100 * number, "fit": fit_text(number)}
        fields["used"] = counted(number, "log")
        fields["rounded"] = float(f"{number:.2g}")
    return text.format(**fields)


def _number(finding: Finding) -> float:
    assert finding.number is not None  # noqa: S101 - kinds whose sentence asks for one have one
    return finding.number


def _poor_fit(finding: Finding, _: Values) -> str:
    cure = "Check units, signs and masses, and look at the residuals."
    if not math.isfinite(_number(finding)):
        return f"Simulated with these values, the model runs away. {cure}"
    return (
        f"The model follows the logs, their velocity too, with a median FIT of "
        f"{fit_text(_number(finding))} % only: it moves otherwise than this robot. {cure}"
    )


def _contradicted(finding: Finding, _: Values) -> str:
    symbols = [SYMBOLS[name] for name in finding.parameters]
    return (
        "What is known of motor and hand does not go with these values: "
        f"{' and '.join(f'{each.symbol} ({each.meaning})' for each in symbols)} would be "
        f"{_number(finding):.1f} standard errors below 0. Check what was told, its units and the "
        "gear ratio."
    )


def _known_apart(finding: Finding, _: Values) -> str:
    share = _number(finding)
    wanted = f"about {abs(100 * share):.2g} % {'larger' if share > 0 else 'smaller'}"
    return (
        "The added masses contradict what was said to be known of "
        f"{' and '.join(finding.parameters)}: they would have it {wanted}. One of the two is wrong."
    )


def _simulations(finding: Finding, _: Values) -> str:
    how = "converged"
    if finding.severity is Level.WARNING:
        how = "did not converge: do not trust the values"
    return f"The fit {how}, after {counted(_number(finding), 'simulation')} of every log."


def _on_bound(finding: Finding, _: Values) -> str:
    names = ", ".join(finding.parameters)
    if finding.severity is Level.NOTE:
        return f"{names} ended on a bound: these data do not show any."
    return (
        f"{names} ended on a bound that the data would cross: the model misses something, or a "
        "sign, a mass or a stamp is wrong."
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


_TEXTS: dict[FindingKind, str | Callable[[Finding, Values], str]] = {
    FindingKind.PRECISE: "{names} known within {percent:.0f} %",
    FindingKind.ROUGH: "{names} known roughly",
    FindingKind.NOT_FROM_ZERO: "{names} not distinguishable from zero",
    FindingKind.UNIT_ERROR: lambda finding, _: unit_error_text(finding),
    FindingKind.POOR_FIT: _poor_fit,
    FindingKind.UNFOLLOWED: (
        "The model does not follow {logs} (FIT {fit} % at worst): look at what is different there, "
        "or leave out what is not this robot."
    ),
    FindingKind.UNFORETOLD: (
        "Held out, {logs} {are} followed far worse than the logs that were used (FIT {fit} % at "
        "worst): the values do not hold there."
    ),
    FindingKind.NO_INERTIA: (
        "No joint has these values: {names} leaves an inertia of {number:.2g} kg m². Check units, "
        "signs and the added masses."
    ),
    FindingKind.NEGATIVE: (
        "No joint has these values: {names} cannot be negative. Check units, signs and stamps."
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
    FindingKind.KNOWN_APART: _known_apart,
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
    FindingKind.NOT_HELPING: (
        "Not fitted, since {names} did not help to predict logs that were left out."
    ),
    FindingKind.INSEPARABLE: (
        "Not fitted, since these data cannot tell {names} from the other terms."
    ),
    FindingKind.OUTDONE: (
        "Values that these logs give themselves, with the same p4, follow them far better (median "
        "FIT {fit} %): identify them, and compare."
    ),
    FindingKind.ADDS_UP: (
        "Fitted over stretches of {number:g} s, since nothing brings the joint back from what the "
        "model lacks, and over longer ones that adds up to more than the noise."
    ),
    FindingKind.OTHER_END: (
        "Started elsewhere the fit ends elsewhere, where it follows the logs less well "
        "({number:.3g} times the squared error): the best of the ends is given."
    ),
    FindingKind.COMBINATION: (
        "{combined} are known mainly in one combination (condition number {rounded:.0f}): add a "
        "run that tells them apart."
    ),
    FindingKind.ROUNDS: (
        "The iteration did not settle in {number:.0f} rounds: do not trust the values."
    ),
    FindingKind.SIMULATIONS: _simulations,
    FindingKind.ON_BOUND: _on_bound,
    FindingKind.FEW_MASSES: _few_masses,
    FindingKind.FEW_LOGS: (
        "With {used} the intervals come from stretches of time, and hold nothing of how the robot "
        "differs from run to run: record more."
    ),
    FindingKind.UNCHECKED: (
        "The intervals were not checked by leaving an added mass out, as asked."
    ),
    FindingKind.SIGN_UNKNOWN: (
        "The sign of {names} cannot be seen in the motion: its size is given."
    ),
    FindingKind.TORQUE_DRIVEN: _torque_driven,
    FindingKind.NOT_ESTIMATED: _not_estimated,
    FindingKind.NO_UNCERTAINTY: (
        "{number:.0f} resonance frequencies for {count} parameters leave no room for a statement "
        "of uncertainty."
    ),
    FindingKind.MISFIT: (
        "The model misses something: its free runs leave over {number:.3g} times what encoder and "
        "noise explain, whatever its parameters."
    ),
    FindingKind.NO_MISFIT: (
        "Encoder and noise explain what the free runs leave over, but for the parameters' own "
        "errors ({number:.2f} times as much)."
    ),
    FindingKind.MISSING_TERM: _missing_term,
    FindingKind.ABSOLUTE: "Absolute values, the scale set by the known masses.",
    FindingKind.RATIOS: "Ratios to p1: no known mass was changed, and a controller needs no more.",
}
