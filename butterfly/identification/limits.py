"""Covariance of a fit, and the 95 % limits of its values, from all that they rest on.

Errors are independent between clusters (logs, or stretches of few logs), not within. Of values
theta, fitted to residuals r_g with weighted rows X_g of cluster g,

    C = N (sum X_g^T A_g r_g r_g^T A_g X_g) N + what is known,   h = t_nu(0.975) sqrt(diag C)

(see `cluster_covariance`). Other answers show by how much a model errs, and not to which side:
intervals reach as far to either (see `Evidence`):

    h' = max(h, |theta_-g - theta|, |theta_r - theta| + h_r, R |theta|),   g, r: each of these
    limits = theta -+ sqrt(h'^2 + (1.96 e)^2), within the bounds of the values

with theta_-g an estimate of partial data, theta_r a rival, R a misfit of torques over the effect of
a value, and e the error of the simulator that made the logs. It is a maximum and a sum of squares:
the order in which evidence is found does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from butterfly.arrays import ROUNDING, Samples, SavedSamples, unit_columns, unit_diagonal
from butterfly.errors import IdentifiabilityError
from butterfly.identification.trust import FEW, Finding, FindingKind
from butterfly.logs.log import MIN_SAMPLES, Log
from butterfly.model.prior import Penalty
from butterfly.model.terms import TERMS
from butterfly.verdict import CONFIDENCE, SPREADS

CELLS = 10
"""Blocks into which a log is cut: enough to estimate their scatter within a quarter."""

WEIGHED = 0.2
"""Relative tolerance of a variance, and of weights by it: scatter estimates none better."""


SINGULAR_CONDITION = 1 / ROUNDING
"""Above this condition number, a scaled regression is singular for every practical purpose."""


WEAK_CONDITION = SINGULAR_CONDITION**0.5
"""Above this one, half as many digits, one combination is poorly determined."""


OTHER_LOGS = "add logs at other speeds and amplitudes, or with another known mass"
"""Advice where logs have too little information."""


_NOTHING = np.finfo(float).tiny ** 0.5


def cluster_covariance(
    rows: Samples,
    residuals: Samples,
    prior: Penalty | None = None,
    considered: Samples | None = None,
) -> tuple[Samples, Samples]:
    """Return the (p, p) bias-reduced cluster-robust covariance (CR2) and (p,) degrees of freedom.

    Unbiased when the weights are right, and consistent when they are not; few and unequal clusters
    are accounted for by Satterthwaite degrees of freedom, one number per parameter, for Student's t
    (Bell & McCaffrey, Survey Methodology 28, 2002). With X_g the (m, p) weighted rows of cluster g,
    N = (X^T X + W)^-1, W the weights of a prior, and A_g = (I - X_g N X_g^T)^(-1/2), the influence
    of a cluster's (m,) residuals is A_g X_g N. Where one cluster alone determines a combination of
    parameters, it leaves no residual of it: what it hides is taken to vary as what is seen of a
    parameter does, with one degree of freedom (see `Clusters.hidden`). Two parts add with infinite
    degrees of freedom: the prior, and ``considered`` (n, m, k), derivatives of the residuals by k
    quantities that are not estimated, each times its standard uncertainty (Schmidt's considered
    parameters).
    """
    weight = np.zeros(rows.shape[2]) if prior is None else prior.weight
    clusters = Clusters.of(rows, weight)
    scale, normal = clusters.scale, clusters.normal
    scores = np.einsum("nip,ni->np", clusters.influence, residuals) / np.sqrt(clusters.seen)
    covariance = np.asarray(scores.T @ scores)
    given = np.zeros_like(covariance)
    if prior is not None:
        given += prior.variance * (normal * weight / scale**2) @ normal
    if considered is not None:
        moved = normal @ np.einsum("nip,nik->pk", clusters.rows, considered)
        given += moved @ moved.T
    freedom = clusters.freedom(np.diag(covariance), np.diag(given))
    return (covariance + given) / np.outer(scale, scale), freedom


def robust(covariance: Samples, weighted: Samples, bread: Samples) -> Samples:
    """Return the covariance of an M-estimate from that of its weighted least squares.

    The weights depend on the residuals: the derivative of the gradient is ``bread`` (n, n), smaller
    than the ``weighted`` normal equations (Huber & Ronchetti, Robust Statistics, 2nd ed. 2009,
    section 7.6). Where the bread is not positive definite, the covariance stays.
    """
    if np.linalg.eigvalsh(bread / np.sqrt(np.outer(np.diag(weighted), np.diag(weighted))))[0] <= 0:
        return covariance
    change = np.linalg.solve(bread, weighted)
    return np.asarray(change @ covariance @ change.T)


def expected_covariance(rows: Samples, weight: Samples) -> tuple[Samples, Samples]:
    """Return the (p, p) mean of `cluster_covariance` for errors of variance 1, and (p,) freedom.

    ``rows``: (n, m, p) weighted, of clusters; ``weight``: (p,) of a prior.
    """
    clusters = Clusters.of(rows, weight)
    given = np.einsum("ij,j,ji->i", clusters.normal, weight / clusters.scale**2, clusters.normal)
    freedom = clusters.freedom(np.diag(clusters.normal) - given, given)
    return clusters.normal / np.outer(clusters.scale, clusters.scale), freedom


@dataclass(frozen=True, kw_only=True, eq=False)
class Clusters:
    """Weighted rows of n clusters in p parameters, scaled to columns of length 1."""

    rows: Samples  # (n, m, p): X_g
    scale: Samples  # (p,) lengths of the columns, by which they are divided
    normal: Samples  # (p, p): N
    influence: Samples  # (n, m, p): A_g X_g N, A_g without directions that leave no residual
    hidden: Samples  # (n, p) shares of the variance, if the weights are right, in these directions

    @classmethod
    def of(cls, rows: Samples, weight: Samples) -> Clusters:
        """Return the clusters of (n, m, p) rows, with the (p,) weights of a prior."""
        scale = np.sqrt(np.sum(rows**2, axis=(0, 1)) + weight)
        rows = np.asarray(rows / scale)
        flat = rows.reshape(-1, rows.shape[2])
        normal = np.linalg.inv(flat.T @ flat + np.diag(weight / scale**2))
        residual_maker = np.eye(rows.shape[1]) - rows @ normal @ np.swapaxes(rows, 1, 2)
        eigenvalues, axes = np.linalg.eigh(residual_maker)
        along = np.swapaxes(axes, 1, 2) @ rows @ normal
        shows = eigenvalues > ROUNDING
        hidden = np.sum(np.where(shows[:, :, None], 0.0, along**2), axis=1)
        whole = np.sum(along**2, axis=(0, 1))
        roots = np.where(shows, np.maximum(eigenvalues, ROUNDING) ** -0.5, 0.0)
        return cls(
            rows=rows,
            scale=scale,
            normal=np.asarray(normal),
            influence=axes @ (roots[:, :, None] * along),
            hidden=np.divide(hidden, whole, out=np.zeros_like(hidden), where=whole > 0),
        )

    @property
    def seen(self) -> Samples:
        """(p,) shares of the variances in directions that leave residuals."""
        return np.asarray(np.maximum(1 - self.hidden.sum(axis=0), ROUNDING))

    def freedom(self, scatter: Samples, given: Samples) -> Samples:
        """(p,) degrees of freedom of sums of variances by scatter and of given ones, (p,) each."""
        both, moving = scatter + given, (scatter > 0) & (given > 0)
        share = np.divide(scatter, both, out=np.ones_like(scatter), where=moving)
        inverse = self.seen**2 / self._satterthwaite + np.sum(self.hidden**2, axis=0)
        return np.asarray(1 / (inverse * share**2))

    @cached_property
    def _satterthwaite(self) -> Samples:
        """(p,) degrees of freedom tr(P)^2/tr(P^2), with one matrix P for each parameter.

        P = D - B N B^T over clusters: D the squared length of each cluster's influence on the
        parameter, and the rows of B that influence times X_g. It is never formed: memory grows
        with the number of clusters only.
        """
        influence, normal = self.influence, self.normal
        lengths = np.sum(influence**2, axis=1)  # (n, p): the diagonals of D
        b = np.einsum("nij,nip->pnj", self.rows, influence)  # (p, n, p)
        shared = np.swapaxes(b, 1, 2) @ b @ normal  # (p, p, p): B^T B N
        overlap = np.einsum("pnj,jk,pnk->np", b, normal, b)
        trace = lengths.sum(axis=0) - np.trace(shared, axis1=1, axis2=2)
        squares = (lengths**2 - 2 * lengths * overlap).sum(axis=0)
        squares += np.einsum("pij,pji->p", shared, shared)
        # P has no negative eigenvalue: only rounding violates these bounds
        squares = np.clip(squares, trace**2 / self.rows.shape[0], trace**2)
        return np.asarray(np.divide(trace**2, squares, out=np.ones_like(trace), where=squares > 0))


def half_widths(covariance: Samples, freedom: Samples) -> Samples:
    """(n,) half-widths of Student's intervals at `CONFIDENCE`.

    A negative variance is what rounding leaves of one that the data do not determine.
    """
    quantiles, variances = stdtrit(freedom, 0.5 + CONFIDENCE / 2), np.diag(covariance)
    errors = np.sqrt(np.where(variances < 0, np.inf, variances))
    return np.asarray(quantiles * errors, dtype=float)


@dataclass(frozen=True, eq=False)
class Rival:
    """Other values that may be right, which intervals include."""

    values: SavedSamples  # (n,)
    half_widths: SavedSamples | None = None  # (n,) of their own intervals; None: those of the fit
    # whether a fit has them that predicts as well; else a condition, sensor or clock points there
    predicts: bool = True

    def inserted(self, at: int, value: float) -> Rival:
        """Return it with a value more, which is held."""
        half = None if self.half_widths is None else np.insert(self.half_widths, at, 0.0)
        return replace(self, values=np.insert(self.values, at, value), half_widths=half)

    def within(self, some: slice) -> Rival:
        """Return it in some of the values."""
        half = None if self.half_widths is None else self.half_widths[some]
        return replace(self, values=self.values[some], half_widths=half)

    def at_most(self, half: Samples) -> Rival:
        """Return the rival with its half-widths limited to (n,) ``half``."""
        widths = half if self.half_widths is None else np.minimum(self.half_widths, half)
        return replace(self, half_widths=widths)


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """All that the limits of (n,) values rest on.

    Estimates of partial data differ by errors of the model, which more logs do not reduce. Of
    rivals any may be right: half-widths about each are included.
    """

    values: Samples
    half: Samples  # (n,) half-widths by covariance and degrees of freedom
    least: Samples  # (n,) lower bounds of the values
    left_out: Sequence[Samples] = ()  # (n,) estimates of partial data
    rivals: Sequence[Rival] = ()
    bias: Samples | None = None  # (n,) sizes of errors that a misfit of torques may have caused
    simulator: Samples | None = None  # (n,) standard errors by the simulator that made the logs

    @property
    def half_widths(self) -> Samples:
        """(n,) half-widths that include all of it."""
        half = np.array(self.half)
        for other in self.left_out:
            half = np.maximum(half, np.abs(other - self.values))
        for rival in self.rivals:
            about = self.half if rival.half_widths is None else rival.half_widths
            half = np.maximum(half, np.abs(rival.values - self.values) + about)
        if self.bias is not None:
            half = np.maximum(half, self.bias)
        return half if self.simulator is None else np.hypot(half, SPREADS * self.simulator)

    @property
    def limits(self) -> tuple[Samples, Samples]:
        """The (n,) lower and upper limits."""
        half = self.half_widths
        return np.maximum(self.values - half, self.least), self.values + half


def misfit_over_value(rows: Samples, residuals: Samples, values: Samples) -> Samples:
    """(n,) R = |r| / (|p| |s|), with s a value's column less its projection on the others.

    Standard errors take residuals for noise; where these are as large as the effect of a parameter
    alone, a misfit may have biased its value: a ripple of the velocity looks like inertia.
    """
    flat = rows.reshape(-1, rows.shape[-1])
    scaled, size = unit_diagonal(flat.T @ flat)
    alone = size / np.sqrt(np.diag(np.linalg.pinv(scaled)))
    effect, norm = np.abs(values) * alone, float(np.linalg.norm(residuals))
    most = np.full(effect.size, np.finfo(float).max)
    return np.asarray(np.divide(norm, effect, out=most, where=effect > norm * _NOTHING))


def widened(
    values: Samples, covariance: Samples, left_out: Iterable[Samples], rivals: Iterable[Samples]
) -> Samples:
    """(n, n) covariance, enlarged along partial estimates, as if limits, and along rivals."""
    partial, others = [*left_out], [*rivals]
    if partial:
        distances = np.array(partial) - values
        covariance = covariance + distances.T @ distances / SPREADS**2
    if others:
        distances = np.array(others) - values
        covariance = covariance + distances.T @ distances / len(others)
    return covariance


def cells_of(logs: int, parameters: int) -> int:
    """Return the number of cells of each log: all cells are twice the parameters at least."""
    return max(CELLS, -(-2 * parameters // logs))


def independent_cells_of(logs: int, parameters: int) -> int:
    """Return the number of cells of each log whose errors count as independent: 1 of many logs."""
    return cells_of(logs, parameters) if logs <= FEW else 1


def edges_of(time: Samples, count: int) -> list[int]:
    """Return the samples at which blocks of a log begin; fewer than ``count`` if too short."""
    if time.size < MIN_SAMPLES:
        return []
    edges = [0]
    for k in np.searchsorted(time, np.linspace(time[0], time[-1], count + 1)[1:-1]).tolist():
        if min(k - edges[-1], time.size - k) >= MIN_SAMPLES:
            edges.append(k)
    return edges


def length_of(log: Log) -> float:
    """Return the length in s of the blocks of a log: whole periods of its drive."""
    length = float(log.time[-1] - log.time[0]) / CELLS
    if log.excitation is None:
        return length
    period = 2 * math.pi / log.excitation.omega
    return math.ceil(length / period) * period


@dataclass(frozen=True)
class Conditioning:
    """Conditioning of a regression, whatever the units of its parameters."""

    number: float  # condition number with the columns scaled to one length
    weakest: tuple[str, ...]  # parameters of the combination that is determined worst
    sum: str = ""  # of two such, the sentence on the combination that is determined

    @classmethod
    def of(
        cls,
        rows: Samples,
        names: tuple[str, ...],
        known: NDArray[np.bool_] | None = None,
        about: tuple[Samples, Samples] | None = None,
    ) -> Conditioning:
        """Return the conditioning of (m, n) rows; ``known``: (n,) mask of those with a prior."""
        # ``about``: values and residuals, to compute the combination of two parameters
        scaled, size = unit_columns(rows)  # one without effect makes the regression singular
        whole = scaled if known is None else np.concatenate([scaled, np.eye(len(names))[known]])
        _, singular, right = np.linalg.svd(whole, full_matrices=False)
        # those of more than an equal share of the direction
        largest = np.flatnonzero(right[-1] ** 2 > 1 / (1 + len(names)))
        number = float(singular[0] / singular[-1]) if singular[-1] > 0 else math.inf
        conditioning = cls(number=number, weakest=tuple(names[k] for k in largest))
        ours = largest.size == 2 and {*conditioning.weakest} <= TERMS.keys()  # noqa: PLR2004 - a sum
        if about is None or not ours:
            return conditioning
        values = about[0] - np.linalg.lstsq(scaled, about[1], rcond=1 / WEAK_CONDITION)[0] / size
        (first, second), (one, other) = conditioning.weakest, right[-1][largest] / size[largest]
        share = float(-one / other)
        both = float(values[largest[0]] + share * values[largest[1]])
        text = f"{first} {'+' if share > 0 else '-'} {abs(share):.3g} {second} is {both:.4g}"
        most = f", {first} at most that" if share > 0 and not TERMS[second].lower < 0 else ""
        return replace(conditioning, sum=f"{text}{most}")

    @property
    def singular(self) -> bool:
        """Whether it is singular for every practical purpose."""
        return self.number > SINGULAR_CONDITION

    @property
    def refusal(self) -> IdentifiabilityError:
        """The error that names the parameters that are not identifiable."""
        alone = " separately" if len(self.weakest) > 1 else ""
        but = f", but {self.sum}" if self.sum else ""
        return IdentifiabilityError(
            f"{' and '.join(self.weakest)} cannot be identified{alone} from these logs (condition "
            f"number {self.number:.1e}){but}: {OTHER_LOGS}"
        )

    def require(self) -> None:
        """Raise the refusal if it is singular."""
        if self.singular:
            raise self.refusal

    @property
    def findings(self) -> list[Finding]:
        """The finding of a poorly determined combination, if any."""
        if self.number <= WEAK_CONDITION:
            return []
        return [Finding(FindingKind.COMBINATION, self.weakest, number=self.number)]
