"""The result of an identification: the estimate, and how it follows the logs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import InputError, listed
from butterfly.identification.data import DataSet, read_data_set
from butterfly.identification.diagnostics.residuals import Residuals, residuals_of
from butterfly.identification.estimators import Estimator
from butterfly.identification.free_run import FitSummary, FreeRun, WholeRuns
from butterfly.identification.inference.estimate import Estimate
from butterfly.identification.parameters_by_hand import OtherParameters
from butterfly.identification.physical import PhysicalParameters, physical_parameters
from butterfly.logs.log import InputKind
from butterfly.logs.manifest import Manifest
from butterfly.model.parameters import GRAVITY, NO_ADDED_MASS, AddedMass, LumpedParameters
from butterfly.model.prior import PHYSICAL, Prior
from butterfly.signals.frequency_response import measured_response

if TYPE_CHECKING:
    import control


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Identified:
    """The result of an identification."""

    estimate: Estimate
    """Parameters with covariance and findings."""

    estimator: str
    """Method and options, in a line."""

    origin: dict[str, Any]
    """The data: name, description, input, number of logs, what was known of the robot, its joint
    and gravity, and the manifest that the logs were read by."""

    fits: dict[str, float]
    """FIT in per cent of the free run of each log, by its name."""

    velocity_fits: dict[str, float] = field(default_factory=dict)
    """The same of its velocity."""

    held_out: dict[str, float] = field(default_factory=dict)
    """FIT in per cent of each that was held out."""

    mean_errors: dict[str, float] = field(default_factory=dict)
    """Mean absolute error in rad of each servo's log, held out or not, in its loop."""

    open_loop_fits: dict[str, float] = field(default_factory=dict)
    """FIT in per cent of each of these by its recorded or rebuilt drive alone."""

    zeros: dict[str, float] = field(default_factory=dict)
    """The encoder's reading in rad at angle 0 of each log; none where no gravity acts."""

    logs: DataSet | None = None
    """The data set; None for a result that was loaded, whose logs are read again by `data`."""

    runs: tuple[FreeRun, ...] = ()
    """Free run of each log; those of a result that was loaded are simulated by `free_runs`."""

    judged_residuals: Residuals | None = None
    """Residuals of the free runs; those of a result that was loaded are found by `residuals`."""

    comparisons: tuple[OtherParameters, ...] = ()
    """Other parameters on the same logs."""

    made_by: Estimator | None = None
    """The estimator; None for a result that was loaded."""

    whole: WholeRuns | None = None
    """Runs of whole logs from their start alone, where the free runs are over segments."""

    truth: LumpedParameters | None = None
    """The true parameters of the bare hand, where the logs were simulated."""

    @property
    def parameters(self) -> LumpedParameters:
        """The parameters of the bare hand."""
        return self.estimate.parameters

    @property
    def covariance(self) -> Samples:
        """(n, n), in the order of `rows`."""
        return self.estimate.covariance

    def separated(self, known: Mapping[str, Any] = MappingProxyType({})) -> PhysicalParameters:
        """Return the physical parameters, with further known values by names of `PHYSICAL`."""
        before, new = Prior.of(self.origin.get("known", {})), Prior.of(known)
        for name in known:
            if name not in new.physical:
                raise InputError("physical", name, "no part of motor or hand", listed([*PHYSICAL]))
            if name in before.physical:
                expected = "what was not known before; else identify again with it"
                raise InputError("physical", name, known[name], expected)
        gravity = float(self.origin.get("gravity", GRAVITY))
        carrier = AddedMass(gravity=gravity, joint=self.estimate.joint)
        kind = InputKind(self.origin["input"])
        return physical_parameters(self.estimate, before | new, kind, carrier)

    @property
    def fit(self) -> FitSummary:
        """Median, mean and worst FIT in per cent."""
        return FitSummary.of(self.fit_of_logs, self.estimate.horizon, self.whole)

    @property
    def velocity_fit(self) -> FitSummary:
        """The same of the velocity."""
        return FitSummary.of(np.array([*self.velocity_fits.values()] or [np.nan]))

    @property
    def fit_of_logs(self) -> Samples:
        """(n,) FIT of each log in per cent."""
        return np.array([run.fit for run in self.runs] or list(self.fits.values()))

    @cached_property
    def data(self) -> DataSet:
        """The logs; of a loaded result read again, InputError if they cannot be."""
        if self.logs is not None:
            return self.logs
        manifest = self.origin["manifest"]
        if manifest is None or manifest["root"] is None:
            expected = "one whose logs came from one source of files, to be read again"
            raise InputError("a result that was loaded", "logs", "none", expected)
        return read_data_set(Manifest.model_validate(manifest))

    @cached_property
    def free_runs(self) -> tuple[FreeRun, ...]:
        """Simulation of each log with the estimate; raises as `data` does."""
        data = self.data
        return self.runs or tuple(
            data.simulations.run(number, self.estimate) for number in range(len(data.logs))
        )

    @cached_property
    def residuals(self) -> Residuals:
        """Residuals of the free runs, and whether the sensors explain them."""
        return self.judged_residuals or residuals_of(self.data, self.estimate, self.free_runs)

    def measured(self, added_mass: AddedMass = NO_ADDED_MASS) -> control.FrequencyResponseData:
        """Return the responses measured with an added mass, to compare with `model.linearised`.

        The mass is one of ``data.masses``; none if not given.
        """
        return measured_response(self.data.sines, added_mass)
