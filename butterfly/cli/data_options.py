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
from butterfly.logs.pieces import WHOLE, Cut
from butterfly.model.known import NOTHING, Knowledge, Known, known_of

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping
    from pathlib import Path

    from butterfly.identification.data import DataSet
    from butterfly.logs.health import Repair
    from butterfly.logs.manifest import Manifest
    from butterfly.model.parameters import JointKind

_BESIDES = {"known", "zero", "joint", "gravity", "cut"}  # said after a manifest is found


@dataclass(frozen=True, kw_only=True)
class DataOptions:
    """What was said of data, beside naming it (see `butterfly.experiment.data_source`)."""

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
    cut: Cut = WHOLE

    def manifest(self, source: Path, *, loose: bool = False) -> Manifest:
        """Describe the data that a user named; loose if it may be a folder of any logs."""
        from butterfly.experiment.data_source import manifest_of  # noqa: PLC0415 - slow to import

        about = {name: value for name, value in vars(self).items() if name not in _BESIDES}
        told = manifest_of(source, loose=loose, **about)
        moving = told.moving(self.joint, self.gravity)
        return self.cut.of(moving.knowing(self.known).with_zero(self.zero))

    def read(self, source: Path) -> DataSet:
        """Read the data that a user named."""
        from butterfly.identification.data import read_data_set  # noqa: PLC0415 - slow to import

        return read_data_set(self.manifest(source), show_progress)


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
        cut = Cut(**{name: told.pop(name) for name in ("begin", "end", "restarts")})
        return DataOptions(**pairs, repair=repair, known=facts, zero=reading, cut=cut, **told)

    return with_options(command, "options", declared, make)
