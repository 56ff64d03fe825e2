"""What an identification, an estimate's ending and its findings say, in plain English."""

from __future__ import annotations

from typing import TYPE_CHECKING

from butterfly.identify.judgement.findings import FindingKind, Severity
from butterfly.model.terms import TERMS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from butterfly.identify.estimate import ParameterEstimate
    from butterfly.identify.identification import Identification
    from butterfly.identify.judgement.findings import Finding

    Values = Mapping[str, float]

_LEAST_MASSES = 3  # of which one can be left out


def summary(identification: Identification) -> list[str]:
    """Say in plain words what was found."""
    fit, data = identification.summary, identification.data
    flagged = sum(bool(health.findings) for health in data.health)
    voltage = data.input_kind == "voltage"
    return [
        f"{len(data.logs)} logs with {len(data.masses)} added masses, driven by "
        f"{'voltage' if voltage else 'torque command'}, "
        f"method: {identification.estimate.method}.",
        f"Simulated from the first sample on with the recorded input alone, the model follows "
        f"the measured angle with a median FIT of {fit.median:.1f} % (mean {fit.mean:.1f} %, "
        f"worst {fit.worst:.1f} %); 100 % is perfect, 0 % no better than a constant.",
        *sentences(identification.estimate),
        f"{flagged} of {len(data.logs)} logs have findings in their health record.",
    ]


def sentences(estimate: ParameterEstimate) -> list[str]:
    """Say how far an estimate is to be trusted: how well each parameter is known, then the rest."""
    values = dict(zip(estimate.names, estimate.values.tolist(), strict=True))
    return sentences_of(estimate.findings, values)


def sentences_of(findings: Sequence[Finding], values: Values) -> list[str]:
    """Say what findings about the values of parameters mean (see `sentences`)."""
    precision = [_PRECISION[each.kind](each) for each in findings if each.kind in _PRECISION]
    others = [each for each in findings if each.kind not in _PRECISION]
    known = ["; ".join(precision) + "."] if precision else []
    return [*known, *(_SENTENCES[each.kind](each, values) for each in others)]


def _joined(finding: Finding, link: str = ", ") -> str:
    return link.join(finding.parameters)


def _number(finding: Finding) -> float:
    assert finding.number is not None  # noqa: S101 - kinds whose sentence asks for one have one
    return finding.number


def _simulations(finding: Finding, _: Values) -> str:
    how = "converged"
    if finding.severity is Severity.WARNING:
        how = "did not converge: do not trust the values"
    return f"The fit {how}, after {_number(finding):.0f} simulations of every log."


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


def _left_over(finding: Finding, _: Values) -> str:
    rows = [TERMS[name] for name in finding.parameters]
    names = " or ".join(row.looks_like or row.name for row in rows)
    return (
        f"What the model leaves over looks like {names} ({_joined(finding, ' or ')}), which it "
        f"lacks: a little of it would explain {100 * _number(finding):.0f} % of the variance."
    )


_PRECISION: dict[FindingKind, Callable[[Finding], str]] = {
    FindingKind.PRECISE: lambda f: f"{_joined(f)} known within {100 * _number(f):.0f} %",
    FindingKind.ROUGH: lambda f: f"{_joined(f)} known roughly",
    FindingKind.NOT_FROM_ZERO: lambda f: f"{_joined(f)} not distinguishable from zero",
}

_SENTENCES: dict[FindingKind, Callable[[Finding, Values], str]] = {
    FindingKind.CONDITION: lambda f, _: (
        f"The regression is well conditioned (condition number {_number(f):.0f})."
    ),
    FindingKind.COMBINATION: lambda f, _: (
        f"{_joined(f, ' and ')} are known mainly in one combination (condition number "
        f"{_number(f):.0f}): add a run that tells them apart."
    ),
    FindingKind.ROUNDS: lambda f, _: (
        f"The iteration did not settle in {_number(f):.0f} rounds: do not trust the values."
    ),
    FindingKind.SIMULATIONS: _simulations,
    FindingKind.ON_BOUND: lambda f, _: (
        f"{_joined(f)} ended on a bound: the bound, not the data, sets it, as with friction that "
        "the data do not show, or a model that misses something."
    ),
    FindingKind.FEW_MASSES: _few_masses,
    FindingKind.UNCHECKED: lambda _f, _v: (
        "The intervals were not checked by leaving an added mass out, as asked."
    ),
    FindingKind.SIGN_UNKNOWN: lambda f, _: (
        f"The sign of {_joined(f)} cannot be seen in the motion: its size is given."
    ),
    FindingKind.TORQUE_DRIVEN: _torque_driven,
    FindingKind.NOT_ESTIMATED: lambda f, _: (
        f"This method estimates neither {_joined(f, ' nor ')}: the best p4 is used."
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
