"""What not all logs share in a fit of free runs: whose each zero, bias and first velocity is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.model.prior import Known

Key = tuple[str, "AddedMass | str | None"]
"""A parameter, and whose it is: all logs', if None."""
_ZERO = "zero"


def local_keys(
    logs: Sequence[Log],
    per_mass: Sequence[str],
    per_log: Sequence[str],
    *,
    hangs: bool,
    anchored: Sequence[Log],
) -> list[Key]:
    """Return what is fitted besides the robot's parameters: no zero that is known exactly."""
    open_ = [log for log in logs if not _is_exact(log)]
    concerned = {_ZERO: open_, "velocity": anchored}
    keys: list[Key] = [
        (name, mass)
        for name in per_mass
        for mass in sorted({log.added_mass for log in concerned.get(name, logs)})
    ]
    keys += [
        (name, log)
        for name in per_log
        for log in dict.fromkeys(log.name for log in concerned.get(name, logs))
    ]
    if hangs and _ZERO not in {*per_mass, *per_log}:
        keys += _zero_keys(open_)
    return keys


def _zero_keys(logs: Sequence[Log]) -> list[Key]:
    told = {log.zero for log in logs}
    if len(told) < 2:  # noqa: PLR2004 - the same is known of all, or nothing
        return [(_ZERO, None)] if logs else []
    masses: dict[AddedMass, set[Known | None]] = {}
    for log in logs:
        masses.setdefault(log.added_mass, set()).add(log.zero)
    keys: dict[Key, None] = {}
    for log in logs:
        if log.zero is None:
            keys[_ZERO, None] = None
        else:
            alone = len(masses[log.added_mass]) == 1
            keys[_ZERO, log.added_mass if alone else log.name] = None
    return list(keys)


def columns_of(keys: Sequence[Key], log: Log) -> list[int]:
    """Return the numbers of the keys that concern a log; its own zero goes before a shared one."""
    owners = (log.name, log.added_mass, None)
    mine = [k for k, (_, whose) in enumerate(keys) if whose in owners]
    zeros = sorted((k for k in mine if keys[k][0] == _ZERO), key=lambda k: owners.index(keys[k][1]))
    lost = zeros if _is_exact(log) else zeros[1:]
    return [k for k in mine if k not in lost]


def known_zeros(keys: Sequence[Key], logs: Sequence[Log]) -> Mapping[Key, Known]:
    """Return what is known of the zeros that are fitted, with an uncertainty."""
    told: dict[Key, set[Known | None]] = {}
    for log in logs:
        for k in columns_of(keys, log):
            if keys[k][0] == _ZERO:
                told.setdefault(keys[k], set()).add(log.zero)
    single = {key: next(iter(each)) for key, each in told.items() if len(each) == 1}
    return {key: zero for key, zero in single.items() if zero is not None}


def _is_exact(log: Log) -> bool:
    return log.zero is not None and log.zero.fixed
