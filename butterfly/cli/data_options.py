"""What a command that takes data may be told of it, and the reading of that data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from butterfly.cli.options import (
    ArmOption,
    ColumnsOption,
    FromOption,
    GravityOption,
    InputOption,
    IntersampleOption,
    JointOption,
    KnownOption,
    RepairOption,
    RestartsOption,
    RootOption,
    ToOption,
    UnitsOption,
    ZeroOption,
    parse_pairs,
)
from butterfly.cli.show_progress import show_progress
from butterfly.cli.signature import option, with_options
from butterfly.logs.log import InputKind, Intersample
from butterfly.model.known import NOTHING, Knowledge, Known, known_of

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping
    from pathlib import Path

    from butterfly.identification.data import DataSet
    from butterfly.logs.health import Repair
    from butterfly.logs.manifest import Manifest
    from butterfly.model.parameters import JointKind


@dataclass(frozen=True, kw_only=True)
class DataOptions:
    """What was said of data, beside naming it (see `butterfly.logs.manifest`)."""

    root: Path | None = None
    arm: float | None = None
    input_kind: InputKind = InputKind.VOLTAGE
    intersample: Intersample = Intersample.ZERO_ORDER_HOLD
    columns: Mapping[str, str] | None = None
    units: Mapping[str, str] | None = None
    repair: Collection[Repair] = ()
    known: Knowledge = NOTHING
    zero: Known | None = None
    joint: JointKind | None = None
    gravity: float | None = None
    begin: float | None = None
    end: float | None = None
    restarts: bool = False

    def manifest(self, source: Path, *, loose: bool = False) -> Manifest:
        """Describe the data that a user named; loose if it may be a folder of any logs."""
        from butterfly.api.sources import manifest_of  # noqa: PLC0415 - slow to import

        return manifest_of(source, massless=loose, **self._description())

    def read(self, source: Path) -> DataSet:
        """Read the data that a user named."""
        from butterfly.api.sources import read  # noqa: PLC0415 - slow to import

        return read(source, track=show_progress, **self._description())

    def _description(self) -> dict[str, Any]:
        return vars(self) | {"known": self.known.as_told()}


def takes_data_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options that say more of data, for its argument ``options``."""
    silent = DataOptions()
    declared = [
        option("root", RootOption, silent.root),
        option("arm", ArmOption, silent.arm),
        option("input_kind", InputOption, silent.input_kind),
        option("intersample", IntersampleOption, silent.intersample),
        option("columns", ColumnsOption, silent.columns),
        option("units", UnitsOption, None),
        option("repair", RepairOption, None),
        option("known", KnownOption, None),
        option("zero", ZeroOption, None),
        option("joint", JointOption, None),
        option("gravity", GravityOption, None),
        option("begin", FromOption, None),
        option("end", ToOption, None),
        option("restarts", RestartsOption, False),
    ]

    def make(told: dict[str, Any]) -> DataOptions:
        pairs: dict[str, Any] = {
            name: None if text is None else parse_pairs(text, f"--{name}")
            for name in ("columns", "units", "known")
            for text in [told.pop(name)]
        }
        known, zero = pairs.pop("known"), told.pop("zero")
        facts = NOTHING if known is None else Knowledge.told(known, "data")
        reading = None if zero is None else known_of(zero, "data", "--zero")
        repair = told.pop("repair") or ()
        return DataOptions(**pairs, repair=repair, known=facts, zero=reading, **told)

    return with_options(command, "options", declared, make)
