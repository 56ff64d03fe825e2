"""An estimate as JSON, and back."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from butterfly.identification.diagnostics.findings import Ending, Finding, FindingKind
from butterfly.identification.estimate import Estimate
from butterfly.model.known import Knowledge
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.model.terms import TERMS
from butterfly.verdict import Level

_LARGEST = 1e60  # of any number: squares of such are numbers too


def estimate_content(estimate: Estimate) -> dict[str, Any]:
    """Return all that `estimate_of` needs, as JSON can hold it once NaN is null."""
    return {
        "method": estimate.method,
        "names": list(estimate.names),
        "values": estimate.values.tolist(),
        "covariance": estimate.covariance.tolist(),
        "lower": estimate.lower.tolist(),
        "upper": estimate.upper.tolist(),
        "left_out": [[_key(key), each.tolist()] for key, each in estimate.left_out.items()],
        "rivals": [each.tolist() for each in estimate.rivals],
        "freedom": None if estimate.freedom is None else estimate.freedom.tolist(),
        "condition": estimate.condition,
        "on_bound": list(estimate.on_bound),
        "ending": str(estimate.ending),
        "findings": [asdict(finding) for finding in estimate.findings],
        "held": estimate.held,
        "known": estimate.known.as_told(),
        "resonances": [[_key(mass), omega] for mass, omega in estimate.resonances.items()],
        "horizon": 0.0 if estimate.horizon == math.inf else estimate.horizon,
        "local": [[_key(key), values] for key, values in estimate.local.items()],
    }


def estimate_of(content: dict[str, Any]) -> Estimate:
    """Return the estimate of which `estimate_content` told.

    Raises
    ------
    KeyError, TypeError, ValueError
        If something is missing, or not what it should be.
    """
    left_out: dict[Hashable, NDArray[np.float64]] = {
        _keyed(key): _array(values) for key, values in content["left_out"]
    }
    names = tuple(str(name) for name in content["names"])
    columns = {key: _array(content[key]) for key in ("values", "lower", "upper")}
    covariance = _array(content["covariance"])
    freedom = content.get("freedom")
    rivals = tuple(_array(values) for values in content.get("rivals", ()))
    lengths = [each.shape for each in (*columns.values(), *left_out.values(), *rivals)]
    if covariance.shape != 2 * (len(names),) or any(each != (len(names),) for each in lengths):
        raise ValueError("not as many values as names")
    on_bound = tuple(content["on_bound"])
    held = {str(name): float(value) for name, value in content["held"].items()}
    if not {*names, *on_bound, *held} <= TERMS.keys() or len({*names}) < len(names):
        raise ValueError("names that are no parameters, or twice the same")
    if not np.isfinite([columns["values"], *left_out.values(), *rivals]).all():
        raise ValueError("values that are no numbers")
    if (np.diag(covariance) < 0).any():
        raise ValueError("variances below 0")
    return Estimate(
        method=str(content["method"]),
        names=names,
        covariance=covariance,
        values=columns["values"],
        lower=columns["lower"],
        upper=columns["upper"],
        left_out=left_out,
        rivals=rivals,
        known=Knowledge.told(content.get("known", {})),
        freedom=None if freedom is None else _array(freedom),
        condition=float(_array(content["condition"])),
        on_bound=on_bound,
        ending=Ending(content["ending"]),
        findings=tuple(_finding(**each) for each in content["findings"]),
        held=held,
        resonances={_mass(key): float(_array(omega)) for key, omega in content["resonances"]},
        horizon=_horizon(content.get("horizon")),
        local={_keyed(key): dict(each) for key, each in content["local"]},
    )


def _horizon(said: float | None) -> float | None:
    """Return the horizon of an estimate; 0 stands for whole logs."""
    return None if said is None else float(said) or math.inf


def _finding(
    *,
    kind: str,
    parameters: list[str],
    number: float | None,
    severity: str,
    logs: Sequence[str] = (),
) -> Finding:
    return Finding(
        kind=FindingKind(kind),
        parameters=tuple(parameters),
        number=number,
        severity=Level(severity),
        logs=tuple(map(str, logs)),
    )


def _array(values: Any) -> NDArray[np.float64]:  # noqa: ANN401 - whatever stands in the file
    """Return numbers as an array; null is NaN.

    Raises
    ------
    TypeError, ValueError
        If they are none, or so large that nothing can be made of them.
    """
    found = np.array(values, dtype=np.float64)
    if (np.abs(found) > _LARGEST).any():
        raise ValueError(f"numbers above {_LARGEST:g}")
    return found


def _key(key: object) -> object:
    """Return what a value belongs to: a log by its name, an added mass by its numbers, or all."""
    return asdict(key) if isinstance(key, AddedMass) else key


def _keyed(key: Any) -> AddedMass | str | None:  # noqa: ANN401 - whatever stands in the file
    return _mass(key) if isinstance(key, dict) else key


def _mass(key: dict[str, Any]) -> AddedMass:
    return AddedMass(**key | {"joint": JointKind(key.get("joint", JointKind.HINGE))})
