"""The schema of an experiment file: robot, inputs, estimators and sweep."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import product
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from butterfly.errors import InputError
from butterfly.experiment.methods import AnyEstimator, MethodName, kind_of
from butterfly.experiment.sweep_spec import SEEDS, SweepSpec
from butterfly.files import LONGEST_NAME, is_name
from butterfly.identification.estimators import DEFAULT_METHOD, Estimator
from butterfly.identification.segments import drive_kind
from butterfly.identification.validate import Split
from butterfly.logs.log import MIN_SAMPLES, InputKind, Sine
from butterfly.logs.manifest import KnownValues, LoopFacts
from butterfly.logs.motors import require_drive
from butterfly.model.energy import Orbit
from butterfly.model.linear import LARGEST_SWING, predicted_swing
from butterfly.model.parameters import (
    AddedMass,
    Base,
    Friction,
    Hand,
    JointKind,
    LumpedParameters,
    TorqueDrive,
    VoltageDrive,
)
from butterfly.model.prior import Prior
from butterfly.model.servo import Output, ServoLoop
from butterfly.model.terms import IDEAL, LoopTerms
from butterfly.orbit.controller import Observer, VelocityEstimator
from butterfly.orbit.loop import OrbitSchedule
from butterfly.plant.motor import CommandPath
from butterfly.plant.rig import Rig, Simulator, Spans
from butterfly.plant.robot import Clutch, Robot
from butterfly.plant.sensors import Clock, Encoder, Faults, FilteredDifference
from butterfly.signals.excitations import (
    Chirp,
    Excitation,
    FreeDecay,
    Multisine,
    Prbs,
    SteppedSine,
    Table,
)
from butterfly.yaml_files import OneOf, StrictModel

_ORBIT_STREAM = 2**32 - 1  # a number that no run has


class DriveSpec(OneOf):
    """A voltage-fed motor or a torque-controlled one."""

    voltage: VoltageDrive | None = None
    torque: TorqueDrive | None = None


class PlantSpec(StrictModel):
    """The simulated robot with its controller's clock and encoder."""

    hand: Hand | None = None
    drive: DriveSpec | None = None
    friction: Friction = Friction()
    clutch: Clutch | None = None
    base: Base | None = None
    """A moving base, if any."""
    lumped: LumpedParameters | None = None
    """p1..p4 and friction terms, as identified, instead of all above."""
    simulator: Simulator = Simulator.MUJOCO
    clock: Clock = Clock()
    encoder: Encoder = Encoder()
    path: CommandPath = CommandPath()
    faults: Faults = Faults()
    loop: LoopFacts | None = None
    """Loop of a servo, as in a manifest; excitations and signals are then its setpoints."""
    torque_off: Spans = ()
    """Pairs of start and end times in s between which the servo is off."""
    supply: Table | None = None
    """Supply of the servo in V over time, if not that of the loop."""
    run_in: Annotated[float, Field(ge=0, le=3600)] = 0.0
    """Time in s for which each sine drives the joint before its log begins; not that of a servo."""

    @property
    def servo(self) -> ServoLoop | None:
        """Loop of the servo, if any."""
        return None if self.loop is None else ServoLoop.of(self.loop)

    @property
    def input_kind(self) -> InputKind:
        """Kind of the drive's command."""
        if self.servo is None:
            return self.robot.input_kind
        return drive_kind(self.servo, supplied=self.supply is not None)

    @property
    def robot(self) -> Robot:
        """The described robot."""
        if self.lumped is not None:
            return Robot.of_lumped(self.lumped)
        assert self.hand is not None  # noqa: S101 - or there are lumped parameters
        assert self.drive is not None  # noqa: S101
        return Robot(
            hand=self.hand,
            drive=self.drive.chosen,
            friction=self.friction,
            clutch=self.clutch,
            base=self.base,
        )

    @property
    def rig(self) -> Rig:
        """The robot with how it is run."""
        named = {field.name for field in fields(Rig)} & type(self).model_fields.keys()
        settings = {name: getattr(self, name) for name in named}
        return Rig(robot=self.robot, servo=self.servo, **settings)

    @model_validator(mode="after")
    def _possible(self) -> PlantSpec:
        physical = {"hand", "drive", "friction", "clutch", "base"} & self.model_fields_set
        if self.lumped is None and (self.hand is None or self.drive is None):
            raise ValueError("needs hand and drive, or lumped")
        if self.lumped is not None and physical:
            raise ValueError(
                "use either lumped or hand, drive, friction, clutch and base, not both"
            )
        elsewhere = vars(IDEAL) | vars(LoopTerms()) | {"delay": 0.0}
        if any(getattr(self.lumped, name, value) != value for name, value in elsewhere.items()):
            raise ValueError(
                "put delay, dead_zone and compression under path, and gains under loop"
            )
        assert self.robot  # noqa: S101 - raises if the parts do not fit each other
        if self.clutch is not None and self.simulator is Simulator.GREY_BOX:
            raise ValueError("a clutch needs MuJoCo: the grey-box simulator has no play")
        if self.robot.input_kind is InputKind.VOLTAGE and self.input_kind is not InputKind.VOLTAGE:
            assert self.servo is not None  # noqa: S101 - or the kinds would be the same
            expected = (
                "a law with voltage output, or duty output and a supply, for this voltage drive"
            )
            raise InputError("plant", "loop.law", self.servo.law, expected)
        if self.supply and (self.servo is None or self.servo.rule.output is not Output.DUTY):
            expected = "no supply: only a plant with a loop of duty output has one"
            raise InputError("plant", "supply", "a table", expected)
        if self.torque_off and (self.servo is None or any(a >= b for a, b in self.torque_off)):
            expected = "pairs of start and end time in s, start first, for a plant with a loop"
            raise InputError("plant", "torque_off", self.torque_off, expected)
        return self


class TableFile(StrictModel):
    """Columns of a CSV file: instants in s, and the input held from each."""

    path: Path
    time: str = "time"
    values: str = "input"


class SignalSpec(OneOf):
    """An input other than a plain sine; reading an experiment turns a file into a table."""

    stepped_sine: SteppedSine | None = None
    multisine: Multisine | None = None
    chirp: Chirp | None = None
    prbs: Prbs | None = None
    free_decay: FreeDecay | None = None
    table: Table | None = None
    file: TableFile | None = None


class StateSpec(StrictModel):
    """A state of the joint in rad and rad/s."""

    angle: float
    velocity: float


class TargetSpec(OneOf):
    """The orbit to hold: by its amplitude in rad, its energy in J, or a state on it.

    One that turns over may be given by its mean speed in rad/s, too: its sign is the direction. An
    energy goes with ``direction``.
    """

    amplitude: float | None = None
    energy: float | None = None
    speed: float | None = None
    state: StateSpec | None = None
    direction: Literal[1, -1] = 1
    """Of turning over at an energy: 1 is anti-clockwise."""

    @model_validator(mode="after")
    def _energy_has_a_direction(self) -> TargetSpec:
        if self.energy is None and "direction" in self.model_fields_set:
            raise ValueError("direction goes with energy; speed and state have their own")
        return self

    def __call__(self, parameters: LumpedParameters) -> Orbit:
        """Return the orbit of a joint with these parameters."""
        if self.amplitude is not None:
            return Orbit.of_amplitude(parameters, self.amplitude)
        if self.energy is not None:
            return Orbit.of_energy(parameters, self.energy, self.direction)
        if self.speed is not None:
            return Orbit.of_speed(parameters, self.speed)
        assert self.state is not None  # noqa: S101 - one of the four is
        return Orbit.of_state(parameters, self.state.angle, self.state.velocity)


class DifferenceSpec(StrictModel):
    """A filtered difference; its low pass in s."""

    time_constant: Annotated[float, Field(gt=0)] = 0.003


class ObserverSpec(StrictModel):
    """Luenberger's observer; its bandwidth in rad/s."""

    bandwidth: Annotated[float, Field(gt=0)] = 60.0


class VelocitySpec(OneOf):
    """How the controller estimates the velocity."""

    filtered_difference: DifferenceSpec | None = None
    observer: ObserverSpec | None = None

    def __call__(self, parameters: LumpedParameters, zero: float) -> VelocityEstimator:
        """Return a new estimator for a joint with these parameters."""
        if self.observer is not None:
            return Observer(parameters, zero, self.observer.bandwidth)
        assert self.filtered_difference is not None  # noqa: S101 - one of the two is
        return FilteredDifference(self.filtered_difference.time_constant)


_DIFFERENCE = VelocitySpec(filtered_difference=DifferenceSpec())


@dataclass(frozen=True, kw_only=True)
class ControlSpec(OrbitSchedule):
    """An orbit to hold, the rounds of re-calibration, and the comparison at the end."""

    target: TargetSpec
    velocity: VelocitySpec = _DIFFERENCE
    believed: LumpedParameters | None = None  # of the bare hand; identified if not given
    also: TargetSpec | None = None


class ValidationSpec(StrictModel):
    """Split for cross-validation: what is held out together."""

    split: Split = Split.AUTO
    folds: Annotated[int, Field(ge=2)] | None = None
    """Number of parts, for the splits frequency, log and time."""


class ReportSpec(StrictModel):
    """Number of the worst runs in the report of a sweep."""

    worst: Annotated[int, Field(ge=0)] = 10


class Experiment(StrictModel):
    """One experiment file: every added mass is driven with every excitation and signal."""

    name: Annotated[str, Field(pattern=r"^[\w.-]+$")]
    description: str = ""
    seed: Annotated[int, Field(ge=0, lt=SEEDS)] = 0
    """Seed of all random numbers."""
    plant: PlantSpec
    added_masses: Annotated[list[AddedMass], Field(min_length=1)]
    excitations: tuple[Sine, ...] = ()
    signals: tuple[SignalSpec, ...] = ()
    """Inputs other than sines, for the methods weak-form and output-error."""
    duration: Annotated[float, Field(gt=0)]
    """Length of each run in s."""
    method: MethodName = DEFAULT_METHOD
    terms: tuple[str, ...] | None = None
    """Terms besides p1..p4, coulomb and delay; default: chosen by the method."""
    estimators: tuple[AnyEstimator, ...] = ()
    """Several estimators with options, instead of method and terms."""
    known: KnownValues = Field(default_factory=dict)
    """Known values of the robot for the estimators, as in a manifest."""
    holdout: tuple[str, ...] = ()
    """Names or glob patterns of logs held out from fits for testing."""
    validation: ValidationSpec | None = None
    """Cross-validation of each run; default: none."""
    report: ReportSpec = ReportSpec()
    control: ControlSpec | None = None
    """An orbit to hold, and re-calibration next to it."""
    sweep: SweepSpec | None = None
    """Variations, each a run of its own."""
    keep_signals: bool = False
    """Whether the runs of a sweep keep their logs, as Parquet."""
    extends: str | None = None
    """Another experiment file, in the same folder or shipped, that this one modifies."""

    @field_validator("name")
    @classmethod
    def _of_a_folder(cls, name: str) -> str:
        if not is_name(name):
            raise ValueError(f"expected a valid folder name of up to {LONGEST_NAME} characters")
        return name

    @model_validator(mode="after")
    def _possible(self) -> Experiment:
        believed = self.control is not None and self.control.believed is not None
        if not (self.excitations or self.signals or believed):
            raise ValueError("needs at least one of excitations, signals and control.believed")
        if self.control is not None and self.plant.loop is not None:
            raise ValueError("control commands the drive directly: remove plant.loop")
        require_drive(Prior.of(self.known), self.input_kind, JointKind.HINGE, "experiment")
        self.plant.clock.count(self.duration)
        for number, added in enumerate(self.added_masses):
            self.plant.robot.loaded(added)
            if added.mass and not added.arm:
                name = f"added_masses.{number}.arm"
                raise InputError(
                    "experiment", name, 0, f"more than 0 m for an added mass of {added.mass:g} kg"
                )
        shortest = min([self.duration, *([self.control.duration] if self.control else [])])
        if self.plant.clock.step * MIN_SAMPLES > shortest:
            expected = f"at most {shortest / MIN_SAMPLES:g} s ({MIN_SAMPLES} samples per run)"
            raise InputError("experiment", "plant.clock.step", self.plant.clock.step, expected)
        return self

    @model_validator(mode="after")
    def _one_way_to_name_estimators(self) -> Experiment:
        if self.estimators and {"method", "terms"} & self.model_fields_set:
            raise ValueError("use either estimators, or method and terms, not both")
        # all_estimators refuses terms of another method
        labels = [estimator.label for estimator in self.all_estimators]
        if len(set(labels)) < len(labels):
            raise ValueError("two estimators have the same name; each needs its own")
        return self

    @property
    def all_estimators(self) -> tuple[Estimator, ...]:
        """All named estimators."""
        if self.estimators:
            return self.estimators
        plain = kind_of(self.method)()
        return (plain if self.terms is None else plain.with_terms(self.terms),)

    def runs(self) -> list[tuple[AddedMass, Excitation]]:
        """List added mass and excitation of each run."""
        inputs = [*self.excitations, *(signal.chosen for signal in self.signals)]
        return list(product(self.added_masses, inputs))

    def seeds(self) -> list[np.random.SeedSequence]:
        """Return the random generator of each run, fixed by its place and the seed."""
        return np.random.SeedSequence(self.seed).spawn(len(self.runs()))

    @property
    def orbit_seed(self) -> np.random.SeedSequence:
        """Random generator of the held orbit, which no run uses."""
        return np.random.SeedSequence(self.seed, spawn_key=(_ORBIT_STREAM,))

    def wide_swings(self) -> list[tuple[AddedMass, Sine, float]]:
        """List the runs with a predicted swing beyond `LARGEST_SWING`, in rad.

        A servo follows its sine.
        """
        if self.plant.loop is not None:
            return []
        lumped = self.plant.robot.lumped
        predicted = [
            (
                added,
                sine,
                predicted_swing(lumped.with_added_mass(added), sine.omega, sine.amplitude),
            )
            for added, sine in product(self.added_masses, self.excitations)
        ]
        return [run for run in predicted if run[2] > LARGEST_SWING]

    @property
    def input_kind(self) -> InputKind:
        """Kind of the drive's command."""
        return self.plant.input_kind
