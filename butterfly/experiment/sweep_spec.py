"""The schema of ``sweep:`` in an experiment file, and the resulting runs."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field, model_validator
from scipy.special import ndtri

from butterfly.errors import InputError, require_room
from butterfly.yaml_files import OneOf, StrictModel

Overrides = dict[str, Any]

SEEDS = 2**63
"""Number of possible seeds, within a column of 64-bit integers."""

_BYTES_PER_RUN = 2000  # of a plan
_RANDOM, _HYPERCUBE = 1, 2  # streams of the experiment's seed
_SET_ONCE = "each field in only one of grid, list, random and latin_hypercube"


class Distribution(OneOf):
    """Distribution of the values of a field."""

    uniform: tuple[float, float] | None = None
    log_uniform: tuple[float, float] | None = None
    normal: tuple[float, float] | None = None
    choice: Annotated[list[Any], Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Distribution:
        for name in ("uniform", "log_uniform"):
            limits = getattr(self, name)
            if limits is not None and not limits[0] < limits[1]:
                raise ValueError(f"{name}: expected [lower, upper] with lower < upper")
        if self.log_uniform is not None and not self.log_uniform[0] > 0:
            raise ValueError("log_uniform: limits must be positive")
        if self.normal is not None and not self.normal[1] > 0:
            raise ValueError(
                "normal: expected [mean, standard deviation] with a positive standard deviation"
            )
        return self

    def quantile(self, share: float) -> Any:  # noqa: ANN401 - whatever may be chosen
        """Return the quantile at a fraction."""
        if self.choice is not None:
            return self.choice[min(int(share * len(self.choice)), len(self.choice) - 1)]
        if self.uniform is not None:
            low, high = self.uniform
            return low + share * (high - low)
        if self.log_uniform is not None:
            low, high = (math.log(limit) for limit in self.log_uniform)
            return math.exp(low + share * (high - low))
        assert self.normal is not None  # noqa: S101 - exactly one is
        mean, deviation = self.normal
        return float(mean + deviation * ndtri(share))


class RandomSpec(StrictModel):
    """Random points: their number, and the distribution of each field."""

    count: Annotated[int, Field(gt=0)]
    fields: Annotated[dict[str, Distribution], Field(min_length=1)]


class SweepSpec(StrictModel):
    """Variations of an experiment, in all combinations.

    A field is named by its path, such as ``plant.hand.mass`` or ``added_masses.1.mass``.
    """

    model_config = ConfigDict(populate_by_name=True)

    grid: dict[str, Annotated[list[Any], Field(min_length=1)]] = Field(default={})
    """Values of fields, all combinations."""
    rows: list[dict[str, Any]] = Field(default=[], alias="list")
    """Values of fields, set together."""
    random: RandomSpec | None = None
    """Random points, independent of each other."""
    latin_hypercube: RandomSpec | None = None
    """Random points, evenly spread over each field."""
    repetitions: Annotated[int, Field(gt=0)] = 1
    """Repetitions of each point, with their own seeds."""

    @model_validator(mode="after")
    def _each_field_set_once(self) -> SweepSpec:
        """Refuse a field that a later part would overwrite, alone or with its parents."""
        earlier: list[str] = []
        for alternatives in self._axes:
            for together in alternatives:
                for position, path in enumerate(together):
                    for before in (*earlier, *together[:position]):
                        if f"{before}.".startswith(f"{path}."):
                            raise InputError("sweep", path, f"already set by {before}", _SET_ONCE)
            earlier += {path for together in alternatives for path in together}
        return self

    def way_to(self, path: str, value: object) -> list[str]:
        """Return the keys, from the top of the file, by which a field is set to a value."""
        for part, spec in (("random", self.random), ("latin_hypercube", self.latin_hypercube)):
            if spec is not None and path in spec.fields:
                return ["sweep", part, "fields", path]
        rows = [str(k) for k, row in enumerate(self.rows) if path in row and row[path] == value]
        return ["sweep", "list", rows[0], path] if rows else ["sweep", "grid", path]

    @property
    def _axes(self) -> list[list[tuple[str, ...]]]:
        """Paths set by each part, in order of application."""
        drawn = [tuple(spec.fields) if spec else () for spec in (self.random, self.latin_hypercube)]
        return [[tuple(self.grid)], [tuple(row) for row in self.rows], *([row] for row in drawn)]

    @property
    def fields(self) -> list[str]:
        """Paths of the fields that vary, in order."""
        return list(dict.fromkeys(path for part in self._axes for row in part for path in row))

    def points(self, seed: int, source: object = "sweep") -> Iterator[tuple[Overrides, int, int]]:
        """Yield the overrides, the repetition and the seed of each run, in order.

        A run's seed depends only on the experiment's seed, the repetition and the values set, so a
        growing sweep keeps its runs. A given seed applies to the first repetition; the others are
        derived from it.
        """
        drawn = (spec.count for spec in (self.random, self.latin_hypercube) if spec)
        values = (len(choices) for choices in self.grid.values())
        count = math.prod((*values, *drawn, len(self.rows) or 1, self.repetitions))
        require_room(source, "sweep", f"{count:,} runs", _BYTES_PER_RUN * count)
        axes: list[list[Overrides]] = [
            [dict(zip(self.grid, values, strict=True)) for values in product(*self.grid.values())],
            self.rows or [{}],
            _drawn(self.random, seed, _RANDOM),
            _drawn(self.latin_hypercube, seed, _HYPERCUBE),
        ]
        for parts in product(*axes):
            overrides = {path: value for part in parts for path, value in part.items()}
            for repetition in range(self.repetitions):
                if "seed" in overrides and repetition == 0:
                    yield overrides, repetition, overrides["seed"]
                else:
                    yield overrides, repetition, _derived_seed(seed, repetition, overrides)


def apply(content: Mapping[str, Any], overrides: Overrides, source: object) -> dict[str, Any]:
    """Return an experiment's mapping with fields set by path, created if missing."""
    changed = dict(content)  # all that is not on a way is shared: many variations fit into memory
    for path, value in overrides.items():
        *way, last = path.split(".")
        place: Any = changed
        for part in way:
            place = _entered(place, part, path, source)
        if isinstance(place, list):
            place[_index(place, last, path, source)] = value
        elif isinstance(place, dict):
            place[last] = value
        else:
            raise InputError(source, f"sweep: {path}", place, "the path of a field")
    return changed


def _entered(place: Any, part: str, path: str, source: object) -> Any:  # noqa: ANN401 - any YAML
    """Replace a part of a mapping or list by a copy, and return it for changes."""
    where: Any = part
    if isinstance(place, list):
        where = _index(place, part, path, source)
    elif not isinstance(place, dict):
        raise InputError(source, f"sweep: {path}", place, f"a mapping with the key {part!r}")
    below = place[where] if isinstance(place, list) or where in place else {}
    place[where] = below.copy() if isinstance(below, dict | list) else below
    return place[where]


def _index(place: list[Any], part: str, path: str, source: object) -> int:
    if not (part.isdigit() and int(part) < len(place)):
        raise InputError(source, f"sweep: {path}", part, f"a number from 0 to {len(place) - 1}")
    return int(part)


def _drawn(spec: RandomSpec | None, seed: int, stream: int) -> list[Overrides]:
    if spec is None:
        return [{}]
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(stream,)))
    if stream == _HYPERCUBE:
        from scipy.stats.qmc import LatinHypercube  # noqa: PLC0415 - slow to import

        shares = LatinHypercube(len(spec.fields), rng=rng).random(spec.count)
    else:
        shares = rng.random((spec.count, len(spec.fields)))
    return [
        {
            path: distribution.quantile(share)
            for (path, distribution), share in zip(spec.fields.items(), row, strict=True)
        }
        for row in shares.tolist()
    ]


def _derived_seed(seed: int, repetition: int, overrides: Overrides) -> int:
    text = json.dumps([seed, repetition, overrides], sort_keys=True, default=str)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big") % SEEDS
