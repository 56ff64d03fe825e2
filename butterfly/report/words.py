"""What an identification, an estimate's ending and its findings say, in plain English."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from statistics import median

from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.findings import Ending, Finding, FindingKind, grade
from butterfly.identification.diagnostics.unit_errors.names import listed, slip_in_words
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identification import Identification
from butterfly.identification.physical_formulas import SYMBOLS
from butterfly.model.terms import TERMS
from butterfly.report.inspection import conditions_said
from butterfly.report.zeros import REMEDY
from butterfly.verdict import Level, Verdict

Values = Mapping[str, float]

_FAR_OFF = -1000.0  # FIT in per cent
_LEAST_MASSES = 3  # of which one can be left out


def summary(identification: Identification) -> list[str]:
    """Say in plain words what was found: the verdict, what it rests on, then the numbers."""
    fit, data, estimate = identification.summary, identification.data, identification.estimate
    voltage = data.input_kind == "voltage"
    verdict, *others = sentences(estimate)
    return [
        verdict,
        f"{_logs(data)}, driven by {'voltage' if voltage else 'torque command'}, "
        f"method: {estimate.method}.",
        f"Simulated {_stretch(fit, data)} with the recorded input alone, the model follows "
        f"the measured angle with a median FIT of {fit_said(fit.median)} % (mean "
        f"{fit_said(fit.mean)} %, worst {fit_said(fit.worst)} %); 100 % is perfect, 0 % no better "
        "than a constant.",
        *held_out_sentences(identification.held_out),
        *_thinned(data),
        *_known(estimate),
        *others,
        _health(data),
    ]


def _health(data: DataSet) -> str:
    """Say in which condition the logs are, and where that is told of each."""
    conditions = [health.condition for health in data.health]
    sound = Level.worst(conditions) is Level.GOOD
    where = "" if sound else " `butterfly inspect` tells which, and why."
    return f"Health of the {conditions_said(conditions)}{where}"


def _stretch(fit: FitSummary, data: DataSet) -> str:
    if fit.horizon is None:
        moving = any(log.beginning.velocity for log in data.logs)
        fitted = " (where a log begins in motion, from a start that was fitted to it)"
        return f"from the first sample on{fitted if moving else ''}"
    return f"over segments of {fit.horizon:g} s, each from a start that was fitted to it,"


def held_out_sentences(fits: Mapping[str, float]) -> list[str]:
    """Say how well logs are followed that were not used, by FIT in per cent and name."""
    if not fits:
        return []
    values = sorted(fits.values())
    if len(fits) == 1:
        return [
            f"Held out: {next(iter(fits))}, not used for the fit, has a FIT of "
            f"{fit_said(values[0])} %."
        ]
    return [
        f"Held out: {len(fits)} logs, not used for the fit, have a median FIT of "
        f"{fit_said(median(values))} % (worst {fit_said(values[0])} %): {listed(list(fits))}."
    ]


def _logs(data: DataSet) -> str:
    """Say how many logs there are, and what the hand carried."""
    logs = counted(len(data.logs), "log")
    if len(data.masses) == 1:
        return f"{logs} with {data.masses[0]}"
    return f"{logs} with {len(data.masses)} added masses"


def fit_said(fit: float) -> str:
    """Return FIT in per cent as it is said: of what is far off there is no more to know."""
    return f"{fit:.1f}" if fit > _FAR_OFF else f"less than {_FAR_OFF:.0f}"


def counted(number: float, thing: str) -> str:
    """Return a number of things."""
    return f"{number:.0f} {thing}{'' if number == 1 else 's'}"


def _thinned(data: DataSet) -> list[str]:
    """Say how many samples were averaged, where logs have more than their motion needs."""
    used = sum(log.time.size for log in data.logs)
    sound = sum(health.samples - health.dropped for health in data.health)
    if used == sound:
        return []
    return [f"{used:,} means of neighbouring samples stand for the {sound:,} that were recorded."]


def _known(estimate: Estimate) -> list[str]:
    """Say what was not found out, but told."""
    told = {**estimate.known.parameters, **estimate.known.physical}
    if not told:
        return []
    said = ", ".join(f"{name} = {each}" for name, each in told.items())
    return [f"Known beforehand: {said}."]


def sentences(estimate: Estimate) -> list[str]:
    """Say how far to trust an estimate: the verdict, how well each value is known, the rest."""
    return sentences_of(estimate.ending, estimate.findings, values_of(estimate))


def verdict_on(estimate: Estimate) -> Verdict:
    """Say what may be done with an estimate, and why not more."""
    return verdict_in_words(estimate.ending, estimate.findings, values_of(estimate))


def sentences_of(ending: Ending, findings: Sequence[Finding], values: Values) -> list[str]:
    """Say what an ending and findings about the values of parameters mean (see `sentences`).

    Of values that are not to be used nothing is called known.
    """
    precision = [_PRECISION[each.kind](each) for each in findings if each.kind in _PRECISION]
    level, reasons = grade(ending, findings)
    others = [each for each in findings if each.kind not in _PRECISION and each not in reasons]
    known = ["; ".join(precision) + "."] if precision and level.usable else []
    verdict = verdict_in_words(ending, findings, values)
    return [verdict.sentence, *known, *said_of(others, values)]


def said_of(findings: Sequence[Finding], values: Values) -> list[str]:
    """Say what findings mean that are not about how well a value is known, one after the other."""
    return [_SENTENCES[each.kind](each, values) for each in findings]


def verdict_in_words(ending: Ending, findings: Sequence[Finding], values: Values) -> Verdict:
    """Say the verdict on values, and why it is no better."""
    level, found = grade(ending, findings)
    reasons = said_of(found, values)
    if not reasons and level is not Level.GOOD:
        reasons = ["The estimation did not settle."]
    return Verdict(level, tuple(reasons))


def finding_said(finding: Finding, values: Values) -> str:
    """Say what one finding means, whatever it is about."""
    if finding.kind in _PRECISION:
        return f"{_PRECISION[finding.kind](finding)}."
    return _SENTENCES[finding.kind](finding, values)


def values_of(estimate: Estimate) -> dict[str, float]:
    """Return the values that sentences speak of, by parameter."""
    return estimate.held | dict(zip(estimate.names, estimate.values.tolist(), strict=True))


def _joined(finding: Finding, link: str = ", ") -> str:
    return link.join(finding.parameters)


def _joined_after(finding: Finding) -> str:
    return ", ".join(finding.parameters[1:])


def _number(finding: Finding) -> float:
    assert finding.number is not None  # noqa: S101 - kinds whose sentence asks for one have one
    return finding.number


def _two_digits(number: float) -> str:
    return f"{float(f'{number:.2g}'):.0f}"


def _physical(name: str) -> str:
    return f"{SYMBOLS[name].symbol} ({SYMBOLS[name].meaning})"


def _simulations(finding: Finding, _: Values) -> str:
    how = "converged"
    if finding.severity is Level.WARNING:
        how = "did not converge: do not trust the values"
    return f"The fit {how}, after {counted(_number(finding), 'simulation')} of every log."


def _on_bound(finding: Finding, _: Values) -> str:
    if finding.severity is Level.NOTE:
        return f"{_joined(finding)} ended on a bound: these data do not show any."
    return (
        f"{_joined(finding)} ended on a bound that the data would cross: the model misses "
        "something, or a sign, a mass or a stamp is wrong."
    )


def _few_masses(finding: Finding, _: Values) -> str:
    if _number(finding) < _LEAST_MASSES:
        why = "Fewer than three added masses"
    else:
        why = "Without any one added mass the rest cannot determine the parameters"
    return f"{why}: the intervals could not be checked by leaving one out."


def _torque_driven(finding: Finding, values: Values) -> str:
    resistance = _number(finding)
    return (
        "The data look torque-driven: as a voltage-fed motor it would have a back-EMF constant "
        f"below {resistance * abs(values['p4']):.2g} V s/rad and a resistance below "
        f"{resistance:.2g} Ohm, since its back EMF alone would brake more than p2 does. Check the "
        "manifest's key input."
    )


def _gain(values: Values) -> str:
    return f", {values['p4']:.4g}" if "p4" in values else ""


def _known_apart(finding: Finding, _: Values) -> str:
    share = _number(finding)
    wanted = f"about {abs(100 * share):.2g} % {'larger' if share > 0 else 'smaller'}"
    return (
        f"The added masses contradict what was said to be known of {_joined(finding, ' and ')}: "
        f"they would have it {wanted}. One of the two is wrong."
    )


def _left_over(finding: Finding, _: Values) -> str:
    rows = [TERMS[name] for name in finding.parameters]
    names = " or ".join(row.looks_like or row.name for row in rows)
    return (
        f"What the model leaves over looks like {names} ({_joined(finding, ' or ')}), which it "
        f"lacks: a little of it would explain {100 * _number(finding):.0f} % of the variance."
    )


def _poor_fit(finding: Finding, _: Values) -> str:
    cure = "Check units, signs and masses, and look at the residuals."
    if not math.isfinite(_number(finding)):
        return f"Simulated with these values, the model runs away. {cure}"
    return (
        f"The model follows the logs with a median FIT of {fit_said(_number(finding))} % only: it "
        f"moves otherwise than this robot. {cure}"
    )


_PRECISION: dict[FindingKind, Callable[[Finding], str]] = {
    FindingKind.PRECISE: lambda f: f"{_joined(f)} known within {100 * _number(f):.0f} %",
    FindingKind.ROUGH: lambda f: f"{_joined(f)} known roughly",
    FindingKind.NOT_FROM_ZERO: lambda f: f"{_joined(f)} not distinguishable from zero",
}

_SENTENCES: dict[FindingKind, Callable[[Finding, Values], str]] = {
    FindingKind.SLIP: lambda f, _: slip_in_words(f),
    FindingKind.POOR_FIT: _poor_fit,
    FindingKind.UNFOLLOWED: lambda f, _: (
        f"The model does not follow {listed(f.logs)} (FIT {fit_said(_number(f))} % at worst): look "
        "at what is different there, or leave out what is not this robot."
    ),
    FindingKind.UNFORETOLD: lambda f, _: (
        f"Held out, {listed(f.logs)} {'is' if len(f.logs) == 1 else 'are'} followed far worse than "
        f"the logs that were used (FIT {fit_said(_number(f))} % at worst): the values do not "
        "hold there."
    ),
    FindingKind.NO_INERTIA: lambda f, _: (
        f"No joint has these values: {_joined(f)} leaves an inertia of {_number(f):.2g} kg m². "
        "Check units, signs and the added masses."
    ),
    FindingKind.NEGATIVE: lambda f, _: (
        f"No joint has these values: {_joined(f)} cannot be negative. Check units, signs "
        "and stamps."
    ),
    FindingKind.NEGATIVE_GAIN: lambda f, _: (
        f"{_joined(f)} is negative: a positive input turns the hand towards negative angles. If "
        "the angle or the input counts the other way, say so: sign: -1 in the manifest, or "
        "--units input=-1."
    ),
    FindingKind.TOLD_APART: lambda f, _: (
        f"{_joined(f)} as it is told and as it follows from what is known of motor and hand lie "
        f"{_number(f):.1f} standard uncertainties apart: check both, and the gear ratio."
    ),
    FindingKind.CONTRADICTED: lambda f, _: (
        "What is known of motor and hand does not go with these values: "
        f"{' and '.join(_physical(name) for name in f.parameters)} would be {_number(f):.1f} "
        "standard errors below 0. Check what was told, its units and the gear ratio."
    ),
    FindingKind.KNOWN_APART: _known_apart,
    FindingKind.PRIOR_APART: lambda f, _: (
        f"The logs contradict what was known of {_joined(f)}, by {_number(f):.1f} standard errors: "
        "one of the two is wrong, and the values lie between them."
    ),
    FindingKind.LEFT_OUT: lambda f, _: (
        f"{listed(f.logs)} {'was' if len(f.logs) == 1 else 'were'} left out: the hand turns over, "
        "rests elsewhere or never settles, and the steady response to a sine says nothing there. "
        "The methods weak-form and output-error use them."
    ),
    FindingKind.REST_APART: lambda f, _: (
        f"The hand rests at angles that differ by {_number(f):.2g} rad from mass to mass, as a "
        "constant torque makes it, and this method takes each for the encoder's zero: the methods "
        "harmonic-balance and output-error find the torque."
    ),
    FindingKind.ZERO_GUESSED: lambda f, _: (
        f"Where the hand hangs is a guess in {listed(f.logs)}, and this method takes it as given: "
        f"{REMEDY}. The method output-error fits it."
    ),
    FindingKind.UNPREDICTABLE: lambda f, _: (
        f"{listed(f.logs)} {'was' if len(f.logs) == 1 else 'were'} left out: the hand passes the "
        "upright, where small causes tell, and no simulation from the start stays near. The method "
        "weak-form uses them."
    ),
    FindingKind.MISSING_TERM: lambda f, _: (
        f"{f.parameters[0]} would help to predict logs that were left out, and move "
        f"{_joined_after(f)} by {100 * _number(f):.0f} % or more: add "
        f"{'them' if ',' in f.parameters[0] else 'it'} to the terms."
    ),
    FindingKind.SCANNED: lambda f, _: (
        f"{_joined(f)} is {_number(f):.2g} {TERMS[f.parameters[0]].unit}, found by trying several; "
        "the intervals hold what others that predict as well would give."
    ),
    FindingKind.NOT_HELPING: lambda f, _: (
        f"Not fitted, since {_joined(f)} did not help to predict logs that were left out."
    ),
    FindingKind.INSEPARABLE: lambda f, _: (
        f"Not fitted, since these data cannot tell {_joined(f)} from the other terms."
    ),
    FindingKind.OUTDONE: lambda f, _: (
        "Values that these logs give themselves, with the same p4, follow them far better (median "
        f"FIT {fit_said(_number(f))} %): identify them, and compare."
    ),
    FindingKind.ADDS_UP: lambda f, _: (
        f"Fitted over stretches of {_number(f):g} s, since nothing brings the joint back from what "
        "the model lacks, and over longer ones that adds up to more than the noise."
    ),
    FindingKind.OTHER_END: lambda f, _: (
        "Started elsewhere the fit ends elsewhere, where it follows the logs less well "
        f"({_number(f):.3g} times the squared error): the best of the ends is given."
    ),
    FindingKind.COMBINATION: lambda f, _: (
        f"{_joined(f, ' and ')} are known mainly in one combination (condition number "
        f"{_two_digits(_number(f))}): add a run that tells them apart."
    ),
    FindingKind.ROUNDS: lambda f, _: (
        f"The iteration did not settle in {_number(f):.0f} rounds: do not trust the values."
    ),
    FindingKind.SIMULATIONS: _simulations,
    FindingKind.ON_BOUND: _on_bound,
    FindingKind.FEW_MASSES: _few_masses,
    FindingKind.FEW_LOGS: lambda f, _: (
        f"With {counted(_number(f), 'log')} the intervals come from stretches of time, and hold "
        "nothing of how the robot differs from run to run: record more."
    ),
    FindingKind.UNCHECKED: lambda _f, _v: (
        "The intervals were not checked by leaving an added mass out, as asked."
    ),
    FindingKind.SIGN_UNKNOWN: lambda f, _: (
        f"The sign of {_joined(f)} cannot be seen in the motion: its size is given."
    ),
    FindingKind.TORQUE_DRIVEN: _torque_driven,
    FindingKind.NOT_ESTIMATED: lambda f, values: (
        f"This method estimates neither {_joined(f, ' nor ')}: simulated with the p4 that follows "
        f"the logs best{_gain(values)}."
    ),
    FindingKind.NO_UNCERTAINTY: lambda f, _: (
        f"{_number(f):.0f} resonance frequencies for {len(f.parameters)} parameters leave no room "
        "for a statement of uncertainty."
    ),
    FindingKind.MISFIT: lambda f, _: (
        f"The model misses something: its free runs leave over {_number(f):.3g} times what encoder "
        "and noise explain, whatever its parameters."
    ),
    FindingKind.NO_MISFIT: lambda f, _: (
        "Encoder and noise explain what the free runs leave over, but for the parameters' own "
        f"errors ({_number(f):.2f} times as much)."
    ),
    FindingKind.LEFT_OVER: _left_over,
    FindingKind.ABSOLUTE: lambda _f, _v: "Absolute values, the scale set by the known masses.",
    FindingKind.RATIOS: lambda _f, _v: (
        "Ratios to p1: no known mass was changed, and a controller needs no more."
    ),
}
