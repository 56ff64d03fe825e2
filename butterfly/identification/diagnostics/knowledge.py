"""What knowledge beside the logs does to an estimate, and whether it agrees with them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from butterfly.errors import IdentifiabilityError, InputError
from butterfly.identification.diagnostics.findings import Finding, FindingKind
from butterfly.identification.inference.covariance import cluster_covariance
from butterfly.identification.prior import Prior
from butterfly.identification.solved import Solved
from butterfly.logs.log import Log
from butterfly.model.known import Knowledge
from butterfly.model.parameters import AddedMass, JointKind, rounded
from butterfly.model.terms import GROWING
from butterfly.verdict import Level

Samples = NDArray[np.float64]

_APART = 3.0  # standard errors between what was known and what the logs say
_RARE = 0.9985  # one-sided level of a contradiction, as that many standard errors have it
_MATTERS = 0.01  # share of what is known, less than which is no contradiction
_INSEPARABLE = 1e7  # condition number from which on nothing can be told
_TELLS = 1e-4  # share of the prior's variance, below which the logs say nothing of the parameter


def disagreements(
    prior: Prior | None, names: Sequence[str], values: Samples, covariance: Samples, rows: Samples
) -> list[Finding]:
    """Tell which priors the logs contradict.

    What the estimate differs by from the prior has the variance C + s - 2 v N, with C that of the
    estimate, s that of the prior and v N what the normal equations would have for it.

    Parameters
    ----------
    prior
        Of the n values; None if nothing was known.
    names, values, covariance
        (n,) and (n, n) of the estimate.
    rows
        (m, n) weighted equations, those of the prior among them.
    """
    if prior is None:
        return []
    scale = np.linalg.norm(rows, axis=0)
    normal = np.diag(np.linalg.inv((rows / scale).T @ (rows / scale))) / scale**2
    findings = []
    for k in np.flatnonzero(prior.told).tolist():
        own = prior.variance / prior.weight[k]
        variance = float(covariance[k, k] + own - 2 * prior.variance * normal[k])
        if variance < _TELLS * own:
            continue
        apart = float(abs(values[k] - prior.mean[k]) / np.sqrt(variance))
        if apart > _APART:
            findings.append(
                Finding(
                    kind=FindingKind.PRIOR_APART,
                    parameters=(names[k],),
                    number=apart,
                    severity=Level.CARE,
                )
            )
    return findings


def scale_apart(
    solved: Solved,
    rows: Samples,
    residuals: Samples,
    known: Knowledge,
    carried: Mapping[int, AddedMass],
) -> list[Finding]:
    """Tell whether the added masses contradict parameters that are known exactly.

    Residuals do not change if all torques grow alike, those of the masses among them; so their
    derivative by the known ones' common factor is that of all others, with the sign turned. One
    parameter more, and its step to where the logs would have it.

    Parameters
    ----------
    solved
        The end of a fit that held the known ones.
    rows, residuals
        (k, m, n) and (k, m) equations of k logs.
    known
        Of the robot.
    carried
        What each of the k logs carried, in order.
    """
    told = tuple(name for name in known.scale if name in known.exact)
    masses = list(carried.values())
    names = list(solved.names)
    loads = {"p1": [m.inertia for m in masses], "p3": [m.gravity_moment for m in masses]}
    lost = any(any(load) and name not in names for name, load in loads.items())
    if not told or lost or len({mass.inertia_and_moment for mass in masses}) <= 1:
        return []
    grown = np.tile(np.where([n in GROWING for n in names], solved.values, 0.0), (len(masses), 1))
    for name in set(loads) & set(names):
        grown[:, names.index(name)] += loads[name]
    column = -np.einsum("kmn,kn->km", rows, grown)
    whole = np.concatenate([rows, column[:, :, None]], axis=2)
    flat = whole.reshape(-1, len(names) + 1)
    size = np.linalg.norm(flat, axis=0)
    if not (size > 0).all() or np.linalg.cond(flat / size) > _INSEPARABLE:
        return []
    step = np.linalg.lstsq(flat / size, -residuals.ravel(), rcond=None)[0] / size
    covariance, freedom = cluster_covariance(whole, residuals + whole @ step)
    share, error = float(step[-1]), float(np.sqrt(covariance[-1, -1]))
    sure = max(_APART, float(stdtrit(freedom[-1], _RARE)))
    if abs(share) <= max(sure * error, _MATTERS):
        return []
    return [
        Finding(kind=FindingKind.KNOWN_APART, parameters=told, number=share, severity=Level.CARE)
    ]


def moved_by_masses(
    rows: Samples, names: Sequence[str], carried: Mapping[int, AddedMass]
) -> Samples | None:
    """Return what uncertain added masses, and their arms, do to the residuals of the logs.

    A mass that is off by dm adds dm (l^2 r_1 + g l r_3) to the residuals of its logs, an arm that
    is off by dl adds dl m (2 l r_1 + g r_3), with r_1 and r_3 their derivatives by p1 and p3. Equal
    masses are taken to be the same piece of metal, equal arms the same hole.

    Parameters
    ----------
    rows
        (k, m, n) equations of k logs.
    names
        Of the n parameters.
    carried
        What each of the k logs carried, in order.

    Returns
    -------
    (k, m, q) for q uncertain quantities, each times its standard uncertainty; None if all are
    exact.

    Raises
    ------
    InputError
        If p1 or p3 is known exactly although the mass that is added to it is not.
    """
    moves: dict[tuple[str, float], list[tuple[float, float]]] = {}
    zero = (0.0, 0.0)
    for position, added in enumerate(carried.values()):
        for key, by_inertia, by_gravity in _moves(added):
            own = moves.setdefault(key, [zero] * len(carried))
            own[position] = (by_inertia, by_gravity)
    if not moves:
        return None
    shares = np.array(list(moves.values()))  # (q, k, 2)
    result = np.zeros((*rows.shape[:2], shares.shape[0]))
    for part, name in enumerate(("p1", "p3")):
        if not shares[:, :, part].any():
            continue
        if name not in names:
            expected = f"added masses that are exact, or {name} with an uncertainty"
            raise InputError("known", name, "an exact value beside uncertain masses", expected)
        column = rows[:, :, list(names).index(name)]
        result += column[:, :, None] * shares[:, :, part].T[:, None, :]
    return result


def _moves(added: AddedMass) -> list[tuple[tuple[str, float], float, float]]:
    """Return what a standard uncertainty of a mass, and of its arm, adds to inertia and gravity."""
    found = []
    if added.mass_uncertainty and added.mass:
        share = added.mass_uncertainty / added.mass
        found.append(
            (("mass", rounded(added.mass)), share * added.inertia, share * added.gravity_moment)
        )
    if added.arm_uncertainty and added.arm:
        share = added.arm_uncertainty / added.arm
        found.append(
            (("arm", rounded(added.arm)), 2 * share * added.inertia, share * added.gravity_moment)
        )
    return found


def is_driven(logs: Iterable[Log]) -> bool:
    """Whether any input ever acts."""
    return any(bool(np.any(log.input)) for log in logs)


def refuse_without_scale(
    masses: Iterable[AddedMass], known: Knowledge, *, driven: bool = True
) -> None:
    """Raise IdentifiabilityError if nothing says how large the parameters are.

    All torques of the equation add up to 0, so that p1..p4 times any number would do as well: it
    takes two different added masses, or a parameter that is known and is not 0.

    Parameters
    ----------
    masses
        That the hand carried.
    known
        Of the robot.
    driven
        Whether an input acts.
    """
    if not driven and not {"p4", "delay"} <= known.exact.keys():
        raise IdentifiabilityError(
            "the input is zero throughout, so that p4 and the delay are not seen: add logs of a "
            "driven joint, or say what they are (--known p4=...,delay=0)"
        )
    carried = sorted(set(masses))
    scale = [name for name in known.scale if driven or name != "p4"]
    if scale or len({mass.inertia_and_moment for mass in carried}) > 1:
        return
    what = "the same added mass" if carried[0].mass else "no added mass"
    raise IdentifiabilityError(
        f"all logs carry {what}, so p1..p4 are known only up to a common factor: "
        f"{'; or '.join(_remedies(carried[0], driven=driven))}"
    )


def _remedies(carried: AddedMass, *, driven: bool) -> list[str]:
    """Name what would tell how large the parameters are, of logs that all carry the same."""
    slide = carried.joint is JointKind.SLIDE
    remedies = ["add a run with another known mass (none counts as one)"]
    if driven:
        force = "N" if slide else "N m"
        motor = "resistance=...,torque_constant=..." + (",gear_ratio=..." if slide else "")
        remedies.append(
            f"say what p4 is, {force} per unit of input: --known p4=1 for a command in {force}, "
            f"--known {motor} of a motor that is fed with a voltage"
        )
    if carried.gravity:
        remedies.append("say what p3 is: --known p3=..., the hand's weight in N times l_c in m")
    remedies.append(f"say what p1 is: --known p1=..., in {'kg' if slide else 'kg m²'}")
    return remedies
