"""Random effects of friction and gain from log to log, and weights of logs that include them.

From day to day friction differs by a fifth, the gain by a hundredth. Least squares takes that for
noise, and the logs with most friction bias the inertia. Here it is a random effect. In the
singular vectors U of a log's (m, n) derivatives J, its (m,) residuals r are

    U'r = -R change of the parameters + errors,   R = U'J,
    V = U'NU + misfit^2 I + R T R'

the variance of the errors: N has the autocovariance of r less its projection on J, T is diagonal,
(friction * value)^2 of the terms of friction, (gain * p4)^2, 0 else. Misfit, friction and gain
maximise the restricted likelihood (REML: Patterson & Thompson, Biometrika 58, 1971), with weak
priors that shrink them to 0 where logs have little information. Divided by a root of V, rows and
residuals have independent errors of variance 1. Inertia and gravity have no random effects: the
scale stays identifiable. Where motions are not linear in a log's friction, U, R and r are taken
about that log's predicted random effects (Lindstrom & Bates, Biometrics 46, 1990).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.optimize import minimize

from butterfly.arrays import Samples, unit_columns
from butterfly.identification.findings import Finding, FindingKind
from butterfly.identification.limits import CELLS
from butterfly.identification.linearisation import Linearisation
from butterfly.identification.parameter import CLEARLY, MATTERS
from butterfly.identification.submodels import NEGLIGIBLE
from butterfly.model.prior import Penalty
from butterfly.model.terms import DISSIPATIVE, GROWING

_MOST = 100.0  # usual sizes, up to which the likeliest is sought
_BEGINS = 0.5, 0.01  # usual sizes, from which it is sought

FRICTION = frozenset({row.name for row in DISSIPATIVE} & GROWING)
"""Terms of friction."""

_USUAL = (0.003, 0.1, 0.02)
"""Usual misfit over the motion, and usual relative scatter of friction and of the gain: standard
deviations of their priors, the first in addition to the level of the noise."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scatter:
    """Standard deviations of the random effects, and those of k logs in n values."""

    misfit: float  # of errors by neither noise nor parameters, over the motion
    friction: float  # of every term of friction from log to log, over its value
    gain: float  # of p4 from log to log, over its value
    names: tuple[str, ...] = ()  # of the n values
    # (k, n) what each log is simulated with besides
    effects: Samples = field(default_factory=lambda: np.empty((0, 0)))
    noise: tuple[Samples, ...] = ()  # (m,) errors of each log, with the autocovariance of noise

    @property
    def sizes(self) -> Samples:
        """(3,) misfit, friction and gain."""
        return np.array([self.misfit, self.friction, self.gain])

    def own_of(self, names: Sequence[str]) -> Samples:
        """(k, m) deviations of each log from some values, by name; 0 of names without one."""
        effects = np.zeros((len(self.effects), len(names)))
        for place, name in enumerate(names):
            if name in self.names:
                effects[:, place] = self.effects[:, self.names.index(name)]
        return effects

    def weighed(self, at: Linearisation, values: Samples, effects: Samples) -> Linearisation:
        """Return equations of k logs about (n,) values, with errors of variance 1.

        The logs were simulated at these values and (k, n) ``effects`` besides.
        """
        return Likelihood(at, values, effects, noise=self.noise).weighed(self)

    def random_effects(self, at: Linearisation, step: Samples) -> Samples:
        """(k, n) predicted (BLUP) deviations of logs from values an (n,) step from `weighed` ones.

        With W'W = 1/V they are -D R'W'W (r + R step), D the variances of the effects.
        """
        rows, residuals = at.stack
        pull = np.einsum("kqn,kq->kn", rows, residuals + rows @ step)
        return np.asarray(-pull * (self.sizes[1:] ** 2 @ spread_of(at.names, at.values) ** 2))


def spread_of(names: Sequence[str], values: Samples) -> Samples:
    """(2, n) values of the terms of friction, and of the gain; 0 of other parameters."""
    whose = [[name in FRICTION for name in names], [name == "p4" for name in names]]
    return np.where(whose, values, 0.0)


class Likelihood:
    """Minus twice the restricted log-likelihood of k logs, a function of `Scatter.sizes`.

    The logs were simulated at (n,) values and (k, n) ``effects`` besides. ``prior``: of the values,
    with weights for errors of variance 1. ``noise``: (m,) errors of each log, of which the noise
    has the autocovariance; those that the values leave if not given.
    """

    def __init__(
        self,
        at: Linearisation,
        values: Samples,
        effects: Samples | None = None,
        prior: Penalty | None = None,
        noise: Sequence[Samples] = (),
    ) -> None:
        self._at, self._values, count = at, values, values.size
        logs = [np.split(array, at.ends[:-1]) for array in (at.residuals, at.rows)]
        coordinates = [_coordinates(*log) for log in zip(*logs, strict=True)]
        self.noise = tuple(noise) or tuple(row[-1] for row in coordinates)
        sizes = np.array([along.size for _, along, *_ in coordinates])
        self._present = np.arange(sizes.max()) < sizes[:, None]
        shape = self._present.shape
        self._rows, self._residuals = np.zeros((*shape, count)), np.zeros(shape)
        self._noise = np.tile(np.eye(shape[1]), (shape[0], 1, 1))
        for k, (size, errors, part) in enumerate(zip(sizes, self.noise, coordinates, strict=True)):
            self._rows[k, :size], self._residuals[k, :size], basis, _ = part
            coloured = _coloured(basis, errors) + NEGLIGIBLE**2 * np.eye(size)
            self._noise[k, :size, :size] = coloured
        if effects is not None:
            self._residuals -= np.einsum("kqn,kn->kq", self._rows, effects)
        self._parts = self._parts_of(spread_of(at.names, values))
        self._both = np.concatenate([self._rows, -self._residuals[:, :, None]], axis=2)
        self._known, self._pull = np.zeros(count), np.zeros(count)
        if prior is not None:
            self._known, self._pull = prior.weight, -prior.gradient(values)

    def weighed(self, scatter: Scatter) -> Linearisation:
        """Return equations about the values with independent errors of variance 1."""
        root = np.linalg.cholesky(self._variance(scatter.sizes))
        white = np.linalg.solve(root, np.concatenate([self._rows, self._residuals[:, :, None]], 2))
        logs, size, _ = white.shape
        return replace(
            self._at,
            values=self._values,
            rows=white[:, :, :-1].reshape(-1, self._values.size),
            residuals=white[:, :, -1].ravel(),
            ends=size * np.arange(1, logs + 1),
        )

    def findings(self, scatter: Scatter) -> tuple[Finding, ...]:
        """Return the significant random effects of a likeliest scatter."""
        whole = self.expanded(scatter.sizes)[0]
        groups = ([name for name in self._at.names if name in FRICTION], ["p4"])
        return tuple(
            Finding(FindingKind.SCATTER, tuple(group), number=float(scatter.sizes[k]))
            for k, group in enumerate(groups, start=1)
            # twice the logarithm of a likelihood ratio is a squared normal deviate
            if scatter.sizes[k] > MATTERS
            and self.expanded(self.best(without=k).sizes)[0] - whole > CLEARLY**2
        )

    def expanded(self, sizes: Samples) -> tuple[float, Samples]:
        """Return minus twice the log-likelihood, and its (3,) derivatives.

        It is log|V| + log|R'WR| + e'We with W = 1/V and e the residuals at the best parameters; a
        part dV of V changes it by the trace of dV times W - WR (R'WR)^-1 R'W - We e'W.
        """
        variance = self._variance(sizes)
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
        rows, residuals = weighed[:, :, :-1], weighed[:, :, -1] - weighed[:, :, :-1] @ change
        slope = weight - rows @ inverse @ np.swapaxes(rows, 1, 2)
        slope -= residuals[:, :, None] * residuals[:, None, :]
        slopes = 2 * sizes * (self._parts.reshape(sizes.size, -1) @ slope.ravel())
        return float(logarithms + sums[-1, -1] - pull @ change), slopes

    def best(self, without: int | None = None) -> Scatter:
        """Return the likeliest scatter; the size numbered ``without`` is 0."""
        usual = np.array(_USUAL)
        # root of the mean variance of a coordinate, as the autocovariance of residuals has it
        noise = np.diagonal(self._noise, axis1=1, axis2=2)[self._present]
        if noise.size:  # empty where no parameter moves any log
            usual[0] += CLEARLY * float(np.sqrt(noise.mean()))
        usual[np.arange(usual.size) == without] = 0.0

        def cost(shares: Samples) -> tuple[float, Samples]:
            value, slopes = self.expanded(shares * usual)
            return value + float(shares @ shares), slopes * usual + 2 * shares

        bounds = [(0.0, _MOST)] * usual.size  # beyond, a step would find V singular
        # from large and from small sizes: at 0 the likelihood is flat
        begins = (np.full(usual.size, share) for share in _BEGINS)
        ends = [minimize(cost, x, jac=True, method="L-BFGS-B", bounds=bounds) for x in begins]
        misfit, friction, gain = (min(ends, key=lambda end: end.fun).x * usual).tolist()
        return Scatter(misfit=misfit, friction=friction, gain=gain)

    def _parts_of(self, spread: Samples) -> Samples:
        """(3, k, q, q) parts of the variance of the logs by misfit, friction and gain of size 1."""
        identity = np.eye(self._present.shape[1]) * self._present[:, :, None]
        moved = self._rows * spread[:, None, None, :]
        return np.concatenate([identity[None], moved @ np.swapaxes(moved, 2, 3)])

    def _variance(self, sizes: Samples) -> Samples:
        """(k, q, q) V of each log, regularised by rounding errors for exact data."""
        variance = self._noise + np.tensordot(sizes**2, self._parts, 1)
        count = variance.shape[1]
        least = count * np.finfo(float).eps * np.trace(variance, axis1=1, axis2=2)
        return np.asarray(variance + least[:, None, None] * np.eye(count))


def _coordinates(residuals: Samples, rows: Samples) -> tuple[Samples, Samples, Samples, Samples]:
    """Return (q, n) R, (q,) U'r, (m, q) U of a log, and (m,) residuals less their projection."""
    basis, triangle = np.linalg.qr(rows)
    scaled, lengths = unit_columns(triangle)
    vectors, sizes, right = np.linalg.svd(scaled, full_matrices=False)
    mask = sizes > np.finfo(float).eps * residuals.size * sizes[0]
    basis = basis @ vectors[:, mask]
    along = basis.T @ residuals
    return sizes[mask, None] * right[mask] * lengths, along, basis, residuals - basis @ along


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
