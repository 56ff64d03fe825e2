"""Random effects of friction and gain from log to log, and weights of logs that include them.

From day to day friction differs by a fifth, the gain by a hundredth. Least squares takes that for
noise, so that the logs with most friction bias the inertia. Here it is a random effect. In the
singular vectors U of a log's (m, n) derivatives J, its (m,) residuals r are

    U'r = -R change of the parameters + errors,   R = U'J,
    V = U'NU + misfit^2 I + R T R'

the variance of the errors: N has the autocovariance of r less its projection on J, T is diagonal,
(friction * value)^2 of the terms of friction, (gain * p4)^2, 0 else. Misfit, friction and gain
maximise the restricted likelihood (REML: Patterson & Thompson, Biometrika 58, 1971), with weak
priors that shrink them to 0 where logs have little information. Divided by a root of V, rows and
residuals have independent errors of variance 1. Inertia and gravity have no random effects, so that
the scale stays identifiable. Where motions are not linear in a log's friction, U, R and r are
best those about that log's predicted random effects (Lindstrom & Bates, Biometrics 46, 1990).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.optimize import minimize

from butterfly.arrays import Samples, unit_columns
from butterfly.identification.findings import Finding, FindingKind
from butterfly.identification.inference.blocks import CELLS
from butterfly.identification.inference.submodels import NEGLIGIBLE
from butterfly.identification.levels import CLEARLY, LOST, MATTERS
from butterfly.model.prior import Penalty
from butterfly.model.terms import DISSIPATIVE, GROWING

FRICTION = frozenset({row.name for row in DISSIPATIVE} & GROWING)
"""Terms of friction."""

_USUAL = (0.003, 0.1, 0.02)
"""Usual misfit over the motion, and usual relative scatter of friction and of the gain: standard
deviations of their priors, the first in addition to the level of the noise."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LogRows:
    """Equations of k logs in n parameters, in q coordinates each, padded where a log has fewer."""

    rows: Samples  # (k, q, n): R
    residuals: Samples  # (k, q): U'r
    noise: Samples  # (k, q, q): U'NU
    present: NDArray[np.bool_]  # (k, q) which coordinates are no padding
    left: tuple[Samples, ...]  # (m,) residuals of each log, with the autocovariance in N

    @classmethod
    def of(cls, logs: Iterable[tuple[Samples, Samples]], left: Iterable[Samples] = ()) -> LogRows:
        """Take (m,) residuals and (m, n) derivatives of each log; ``left``: see the field."""
        found = [_coordinates(*log) for log in logs]
        left = tuple(left) or tuple(each[-1] for each in found)
        parts = [
            (turned, along, _coloured(basis, rest) + NEGLIGIBLE**2 * np.eye(along.size))
            for (turned, along, basis, _), rest in zip(found, left, strict=True)
        ]
        sizes = [along.size for _, along, _ in parts]
        present = np.arange(max(sizes)) < np.array(sizes)[:, None]
        count, most = present.shape
        rows = np.zeros((count, most, parts[0][0].shape[1]))
        residuals, noise = np.zeros((count, most)), np.tile(np.eye(most), (count, 1, 1))
        for k, (size, (turned, along, variance)) in enumerate(zip(sizes, parts, strict=True)):
            rows[k, :size], residuals[k, :size], noise[k, :size, :size] = turned, along, variance
        return cls(rows=rows, residuals=residuals, noise=noise, present=present, left=left)

    def moved(self, changes: Samples) -> LogRows:
        """Return the equations after (n,), or (k, n), changes of the parameters."""
        change = np.broadcast_to(changes, (len(self.rows), self.rows.shape[2]))
        residuals = self.residuals + np.einsum("kqn,kn->kq", self.rows, change)
        return replace(self, residuals=residuals)


@dataclass(frozen=True, kw_only=True, eq=False)
class Scatter:
    """Standard deviations of the random effects."""

    misfit: float  # of errors by neither noise nor parameters, over the motion
    friction: float  # of every term of friction from log to log, over its value
    gain: float  # of p4 from log to log, over its value

    def whitened(self, logs: LogRows, spread: Samples) -> tuple[Samples, Samples]:
        """Return (k, q, n) rows and (k, q) residuals with independent errors of variance 1.

        ``spread``: (2, n) values of the terms of friction, and of the gain (see `spread_of`).
        """
        root = np.linalg.cholesky(_variance(logs, _parts(logs, spread), self.sizes))
        both = np.concatenate([logs.rows, logs.residuals[:, :, None]], axis=2)
        white = np.linalg.solve(root, both)
        return white[:, :, :-1], white[:, :, -1]

    def random_effects(self, logs: LogRows, spread: Samples) -> Samples:
        """(k, n) predicted (BLUP) deviations of each log's parameters from those of all."""
        weighted = np.linalg.solve(
            _variance(logs, _parts(logs, spread), self.sizes), logs.residuals[:, :, None]
        )
        pull = np.einsum("kqn,kq->kn", logs.rows, weighted[:, :, 0])
        return np.asarray(-pull * (np.array([self.friction, self.gain]) ** 2 @ spread**2))

    @property
    def sizes(self) -> Samples:
        """(3,) misfit, friction and gain."""
        return np.array([self.misfit, self.friction, self.gain])


def spread_of(names: Sequence[str], values: Samples) -> Samples:
    """(2, n) values of the terms of friction, and of the gain; 0 of other parameters."""
    whose = [[name in FRICTION for name in names], [name == "p4" for name in names]]
    return np.where(whose, values, 0.0)


class Likelihood:
    """Minus twice the restricted log-likelihood of k logs, a function of `Scatter.sizes`.

    ``spread``: see `Scatter.whitened`; ``prior``, ``about``: of the n parameters, with weights
    for errors of variance 1, and the (n,) values that the rows are about.
    """

    def __init__(
        self,
        logs: LogRows,
        spread: Samples,
        prior: Penalty | None = None,
        about: Samples | None = None,
    ) -> None:
        self._logs, self._parts = logs, _parts(logs, spread)
        self._both = np.concatenate([logs.rows, -logs.residuals[:, :, None]], axis=2)
        count = logs.rows.shape[2]
        self._known, self._pull = np.zeros(count), np.zeros(count)
        if prior is not None and about is not None:
            self._known, self._pull = prior.weight, -prior.gradient(about)

    def findings(self, found: Scatter, names: Sequence[str]) -> list[Finding]:
        """Return the significant random effects of a likeliest scatter, of parameters by name."""
        whole = self.expanded(found.sizes)[0]
        groups = ([name for name in names if name in FRICTION], ["p4"])
        return [
            Finding(FindingKind.SCATTER, tuple(group), number=float(found.sizes[k]))
            for k, group in enumerate(groups, start=1)
            # twice the logarithm of a likelihood ratio is a squared normal deviate
            if found.sizes[k] > MATTERS
            and self.expanded(self.best(without=k).sizes)[0] - whole > CLEARLY**2
        ]

    def expanded(self, sizes: Samples) -> tuple[float, Samples]:
        """Return minus twice the log-likelihood, and its (3,) derivatives.

        It is log|V| + log|R'WR| + e'We with W = 1/V and e the residuals at the best parameters; a
        part dV of V changes it by the trace of dV times W - WR (R'WR)^-1 R'W - We e'W.
        """
        variance = _variance(self._logs, self._parts, sizes)
        weight = np.linalg.inv(variance)
        weighed = weight @ self._both
        width = self._both.shape[2]
        sums = self._both.reshape(-1, width).T @ weighed.reshape(-1, width)
        normal = sums[:-1, :-1] + np.diag(self._known)
        normal += np.diag(np.where(np.diag(normal) > 0, 0.0, 1.0))  # of parameters without effect
        scale = np.sqrt(np.diag(normal))
        eigenvalues, axes = np.linalg.eigh(normal / np.outer(scale, scale))
        eigenvalues = np.maximum(eigenvalues, np.finfo(float).eps * eigenvalues[-1])
        inverse = (axes / eigenvalues) @ axes.T / np.outer(scale, scale)
        pull = sums[:-1, -1] + self._pull
        change = inverse @ pull
        logarithms = np.linalg.slogdet(variance)[1].sum() + np.log(eigenvalues).sum()
        logarithms += 2 * np.log(scale).sum()
        rows, left = weighed[:, :, :-1], weighed[:, :, -1] - weighed[:, :, :-1] @ change
        slope = weight - rows @ inverse @ np.swapaxes(rows, 1, 2)
        slope -= left[:, :, None] * left[:, None, :]
        slopes = 2 * sizes * (self._parts.reshape(sizes.size, -1) @ slope.ravel())
        return float(logarithms + sums[-1, -1] - pull @ change), slopes

    def best(self, without: int | None = None) -> Scatter:
        """Return the likeliest scatter; the size numbered ``without`` is 0."""
        usual = np.array(_USUAL)
        # root of the mean variance of a coordinate, as the autocovariance of residuals has it
        noise = np.diagonal(self._logs.noise, axis1=1, axis2=2)[self._logs.present]
        if noise.size:  # empty where no parameter moves any log
            usual[0] += CLEARLY * float(np.sqrt(noise.mean()))
        usual[np.arange(usual.size) == without] = 0.0

        def cost(shares: Samples) -> tuple[float, Samples]:
            value, slopes = self.expanded(shares * usual)
            return value + float(shares @ shares), slopes * usual + 2 * shares

        bounds = [(0.0, 1 / MATTERS)] * usual.size  # beyond, a step would find V singular
        # from large and from small sizes: at 0 the likelihood is flat
        begins = (np.full(usual.size, each) for each in (LOST, MATTERS))
        ends = [minimize(cost, x, jac=True, method="L-BFGS-B", bounds=bounds) for x in begins]
        misfit, friction, gain = (min(ends, key=lambda end: end.fun).x * usual).tolist()
        return Scatter(misfit=misfit, friction=friction, gain=gain)


def _parts(logs: LogRows, spread: Samples) -> Samples:
    """(3, k, q, q) parts of the variance of the logs by misfit, friction and gain of size 1."""
    identity = np.eye(logs.present.shape[1]) * logs.present[:, :, None]
    moved = logs.rows * spread[:, None, None, :]
    return np.concatenate([identity[None], moved @ np.swapaxes(moved, 2, 3)])


def _variance(logs: LogRows, parts: Samples, sizes: Samples) -> Samples:
    """(k, q, q) V of each log, regularised by rounding errors for exact data."""
    variance = logs.noise + np.tensordot(sizes**2, parts, 1)
    count = variance.shape[1]
    least = count * np.finfo(float).eps * np.trace(variance, axis1=1, axis2=2)
    return np.asarray(variance + least[:, None, None] * np.eye(count))


def _coordinates(residuals: Samples, rows: Samples) -> tuple[Samples, Samples, Samples, Samples]:
    """Return (q, n) R, (q,) U'r, (m, q) U of a log, and (m,) residuals less their projection."""
    basis, triangle = np.linalg.qr(rows)
    scaled, lengths = unit_columns(triangle)
    left, sizes, right = np.linalg.svd(scaled, full_matrices=False)
    kept = sizes > np.finfo(float).eps * residuals.size * sizes[0]
    basis = basis @ left[:, kept]
    along = basis.T @ residuals
    return sizes[kept, None] * right[kept] * lengths, along, basis, residuals - basis @ along


def _coloured(basis: Samples, residuals: Samples) -> Samples:
    """(q, q) variance of errors like (m,) residuals along columns, tapered within a cell."""
    count = residuals.size
    lags = max(count // CELLS, 1)
    length = next_fast_len(count + lags, real=True)
    covariance = irfft(np.abs(rfft(residuals, length)) ** 2, length)[:lags] / count
    covariance *= 1 - np.arange(lags) / lags
    even = np.zeros(length)
    even[:lags] = covariance
    even[length - lags + 1 :] = covariance[:0:-1]
    spectrum = np.maximum(rfft(even).real, 0.0)
    both_sides = np.where((np.arange(spectrum.size) * 2) % length == 0, 1.0, 2.0)
    lines = rfft(basis, length, axis=0)
    return np.asarray(((lines.conj().T * (spectrum * both_sides)) @ lines).real / length)
