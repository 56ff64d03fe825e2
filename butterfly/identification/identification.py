"""What was learnt from a data set: the estimate, how it follows the logs, and its views."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from butterfly.arrays import Samples
from butterfly.errors import InputError, listed
from butterfly.files import write_document
from butterfly.identification.data import DataSet, read_data_set
from butterfly.identification.diagnostics.residuals import Residuals, residual_units, residuals_of
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.free_run import FitSummary, FreeRun
from butterfly.identification.parameter import or_nan
from butterfly.identification.parameters_by_hand import OtherParameters
from butterfly.identification.physical import PhysicalParameters, physical_parameters
from butterfly.logs.log import InputKind
from butterfly.logs.manifest import Manifest
from butterfly.model.parameters import (
    GRAVITY,
    NO_ADDED_MASS,
    AddedMass,
    JointKind,
    LumpedParameters,
)
from butterfly.model.prior import PHYSICAL, Prior
from butterfly.result import Result, TextTable, document, text, texts
from butterfly.signals.frequency_response import measured_response
from butterfly.verdict import Verdict

if TYPE_CHECKING:
    import control
    from plotly.graph_objects import Figure

    from butterfly.api.identified_model import IdentifiedModel
    from butterfly.report.identification_figures import IdentificationPlots
    from butterfly.report.parameter_table import Separated
    from butterfly.twin.twin import Twin

_UNITS = {"fit.horizon": "s"} | dict.fromkeys(
    ("fit", "fits", "velocity_fits", "held_out", "drive_fits", "against.fit"), "%"
)
_SAVED = ("summary", "chosen", "against", "residuals")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Identification(Result):
    """What was learnt from a data set."""

    kind: ClassVar[str] = "identification"
    short: ClassVar[bool] = True

    estimate: Estimate
    """Parameters with covariance and findings."""

    estimator: str
    """What made it, and its options, in a line."""

    origin: dict[str, Any]
    """The data: name, description, input, number of logs, what was known of the robot, its joint
    and gravity, and the manifest that the logs were read by."""

    fits: dict[str, float]
    """FIT in per cent of the free run of each log, by its name."""

    velocity_fits: dict[str, float] = field(default_factory=dict)
    """The same of its velocity; the lower of the two says how well a log is followed."""

    held_out: dict[str, float] = field(default_factory=dict)
    """FIT in per cent of each that was held out."""

    mean_errors: dict[str, float] = field(default_factory=dict)
    """Mean absolute error in rad of each servo's log, held out or not, in its loop."""

    drive_fits: dict[str, float] = field(default_factory=dict)
    """FIT in per cent of each of these by its recorded or rebuilt drive alone."""

    logs: DataSet | None = None
    """The data set; None for a result that was loaded, whose logs are read again by `data`."""

    runs: tuple[FreeRun, ...] = ()
    """Free run of each log; those of a result that was loaded are simulated by `free_runs`."""

    judged_residuals: Residuals | None = None
    """What the free runs leave; that of a result that was loaded is found by `residuals`."""

    comparisons: tuple[OtherParameters, ...] = ()
    """Other parameters on the same logs."""

    made_by: Estimator | None = None
    """The estimator; None for a result that was loaded."""

    saved: dict[str, Any] = field(default_factory=dict)
    """What a file said that needs the logs: summary, options, other parameters, residuals."""

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Identification:
        """Return what `to_dict` gave (see `Estimate.from_dict` for what is raised)."""
        from butterfly.report.finding_texts import estimate_sentences  # noqa: PLC0415 - a view

        origin = dict(content["data"])
        InputKind(origin["input"])
        JointKind(origin.get("joint", JointKind.HINGE))
        float(origin.get("gravity", GRAVITY))
        int(origin["logs"])
        if origin["manifest"] is not None:
            manifest = origin["manifest"]
            Manifest.model_validate({**manifest, "root": manifest["root"] or "."})
        texts(content["summary"])
        fits = _fits(content["fits"])
        if not fits:
            raise ValueError("no logs")
        found = cls(
            estimate=Estimate.from_dict(content).usable,
            estimator=text(content["estimator"]),
            origin=origin | {"name": text(origin["name"])},
            fits=fits,
            velocity_fits=_fits(content.get("velocity_fits", {})),
            held_out=_fits(content.get("held_out", {})),
            mean_errors=_fits(content.get("mean_errors", {})),
            drive_fits=_fits(content.get("drive_fits", {})),
            saved={key: content[key] for key in _SAVED if key in content},
        )
        found.separated()
        estimate_sentences(found.estimate)  # fails where a finding names what there is not
        return found

    def to_dict(self, truth: LumpedParameters | None = None) -> dict[str, Any]:
        """Return it as JSON can hold it, beside the truth if that is known (see `Result`)."""
        from butterfly.report import numbers  # noqa: PLC0415 - a view
        from butterfly.report.parameter_table import physical_numbers  # noqa: PLC0415 - a view

        estimate, basis = self.estimate, self.basis()
        of_logs = {key: each for key, each in self.saved.items() if key != "summary"}
        if self.logs is not None:
            of_logs = {
                "against": [each.numbers(estimate) for each in self.comparisons],
                "residuals": numbers.residual_numbers(self.residuals, estimate),
            }
        return document(
            self.kind,
            self.title,
            {
                "estimator": self.estimator,
                "data": basis["data"],
                **numbers.estimate_numbers(estimate, truth),
                "fit": self.fit.numbers(),
                "fits": self.fits,
                "velocity_fits": self.velocity_fits,
                "held_out": self.held_out,
                "mean_errors": self.mean_errors,
                "drive_fits": self.drive_fits,
                "physical": physical_numbers(self.separated()),
                "chosen": basis["chosen"],
                **of_logs,
            },
            verdict=self.judged,
            summary=self.summary,
            units=_UNITS | residual_units(estimate.joint) | {"mean_errors": estimate.joint.way},
        )

    def save(self, path: str | PathLike[str]) -> None:
        """Write the result as JSON, which `butterfly.load` reads, with the place of its logs.

        That is relative to the folder of the file, if they lie below.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        content, manifest = self.to_dict(), self.origin["manifest"]
        folder = Path(path).resolve().parent
        if manifest is not None and manifest["root"] is not None:
            root = Path(manifest["root"])
            root = root.relative_to(folder) if root.is_relative_to(folder) else root
            content["data"]["manifest"]["root"] = root.as_posix()
        schema = content.pop("schema")
        write_document({"schema": schema, "saved": True, **content}, Path(path))

    def basis(self) -> dict[str, Any]:
        """Return the data and options that it rests on, without the place of its logs."""
        from butterfly.report.numbers import chosen_options  # noqa: PLC0415 - a view

        manifest = self.origin["manifest"]
        chosen = chosen_options(self.made_by, self.estimate, self.estimator)
        return {
            "data": {**self.origin, "manifest": manifest and {**manifest, "root": None}},
            "chosen": self.saved.get("chosen", chosen),
        }

    @property
    def title(self) -> str:  # type: ignore[override]
        """Method, data, and the FIT."""
        from butterfly.report.format import fit_text  # noqa: PLC0415 - a view

        fit, name = self.fit, self.origin["name"]
        return f"{self.estimator} of {name!r}, median FIT{fit.over} {fit_text(fit.median)} %"

    @cached_property
    def summary(self) -> tuple[str, ...]:  # type: ignore[override]
        """The verdict, then all that was found, gravest first."""
        from butterfly.report.summary import summary  # noqa: PLC0415 - a view

        return tuple(self.saved["summary"] if self.logs is None else summary(self))

    def rows(self) -> list[dict[str, Any]]:
        """Return a row for each parameter: value, standard error, 95 % interval, unit."""
        columns = ("value", "standard_error", "lower", "upper", "unit")
        return [
            {"parameter": each.name, **{name: getattr(each, name) for name in columns}}
            for each in self.estimate.table()
        ]

    def shown_rows(self) -> list[dict[str, str]]:
        """Return the table of parameters, rounded to their errors."""
        from butterfly.report.parameter_table import parameter_texts  # noqa: PLC0415 - a view

        columns = ("name", "value", "error", "interval", "unit", "meaning")
        names = ("parameter", "value", "standard error", "95 % interval", "unit", "meaning")
        return [
            {name: row[column] for name, column in zip(names, columns, strict=True)}
            for row in map(parameter_texts, self.estimate.table())
        ]

    def tables(self, truth: LumpedParameters | None = None) -> list[TextTable]:
        """Return the tables: parameters (beside the truth if known), physical ones, other FITs."""
        from butterfly.report.summary import tables  # noqa: PLC0415 - a view

        return tables(self, truth)

    def paragraphs(self) -> list[str]:
        """Return the summary; if physical parameters were given, also which remain unknown."""
        from butterfly.report.parameter_table import physical_sentences  # noqa: PLC0415 - a view

        weighed = Prior.of(self.origin.get("known", {})).physical
        return [*self.summary, *(physical_sentences(self.separated()) if weighed else ())]

    def __repr__(self) -> str:
        pairs = zip(self.estimate.names, self.estimate.values, strict=True)
        values = ", ".join(f"{name} {value:.4g}" for name, value in pairs)
        return f"<Identification: {self.title}{self._unless_good()}: {values}>"

    @property
    def judged(self) -> Verdict:  # type: ignore[override]
        """The verdict on its values."""
        from butterfly.report.finding_texts import estimate_verdict  # noqa: PLC0415 - a view

        return estimate_verdict(self.estimate)

    @property
    def parameters(self) -> LumpedParameters:
        """The parameters of the bare hand."""
        return self.estimate.parameters

    @property
    def model(self) -> IdentifiedModel:
        """The robot that they make.

        Raises
        ------
        UnusableError
            If no joint has them.
        """
        from butterfly.api.identified_model import IdentifiedModel  # noqa: PLC0415 - slow to import
        from butterfly.report.finding_texts import require_possible  # noqa: PLC0415

        require_possible(self.estimate)

        def twin(added: AddedMass, mass: float | None) -> Twin:
            from butterfly.twin.twin import Twin  # noqa: PLC0415 - slow to import

            return Twin.identified(self.estimate, self.origin, lambda: self.data, added, mass)

        return IdentifiedModel(self.parameters, self.estimate.joint, twin)

    @property
    def covariance(self) -> Samples:
        """(n, n), in the order of `rows`."""
        return self.estimate.covariance

    def physical(self, **known: Any) -> Separated:  # noqa: ANN401 - see `known_of`
        """Tell what the lumped parameters are made of, as far as it can be told.

        Parameters
        ----------
        known
            What is known of motor and hand besides what the data say of it, by names of
            `butterfly.model.prior.PHYSICAL`: a number, or ``(0.3, 0.01)`` with its uncertainty.

        Raises
        ------
        InputError
            If it is none of these, or was known before.
        """
        from butterfly.report.parameter_table import Separated  # noqa: PLC0415 - a view

        return Separated.of(self.separated(known), self.origin["name"], self.judged)

    def separated(self, known: Mapping[str, Any] = MappingProxyType({})) -> PhysicalParameters:
        """Return the physical parameters, with what is known besides (see `physical`)."""
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
        return FitSummary.of(self.fit_of_logs, self.estimate.horizon)

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
        """The logs; of a loaded result they are read again from where they were.

        Raises
        ------
        InputError
            If it is not known where they are, or they cannot be read.
        """
        if self.logs is not None:
            return self.logs
        found = self.origin["manifest"]
        if found is None or found["root"] is None:
            expected = "one whose logs came from one source of files, to be read again"
            raise InputError("a result that was loaded", "logs", "none", expected)
        return read_data_set(Manifest.model_validate(found))

    @cached_property
    def free_runs(self) -> tuple[FreeRun, ...]:
        """Simulation of each log with the estimate; `data` says what is raised."""
        data = self.data
        return self.runs or tuple(
            data.simulations.run(number, self.estimate) for number in range(len(data.logs))
        )

    @cached_property
    def residuals(self) -> Residuals:
        """What the free runs leave, and whether the sensors explain it."""
        return self.judged_residuals or residuals_of(self.data, self.estimate, self.free_runs)

    def measured(self, added_mass: AddedMass = NO_ADDED_MASS) -> control.FrequencyResponseData:
        """Return the responses measured with an added mass, to stand beside `model.linearised`.

        The mass is one of ``data.masses``; none if not given.

        Raises
        ------
        InputError
            If no sine was logged with it.
        """
        return measured_response(self.data.sines, added_mass)

    @property
    def plot(self) -> IdentificationPlots:
        """Its figures, as plotly's."""
        from butterfly.report.identification_figures import IdentificationPlots  # noqa: PLC0415 - a view

        return IdentificationPlots(self)

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page, by name."""
        return {"frequency-response": self.plot.frequency_response(), "time": self.plot.time()}

    def _repr_html_(self) -> str:
        from butterfly.report.cell import cell_html  # noqa: PLC0415 - a view
        from butterfly.report.identification_page import first_screen  # noqa: PLC0415 - a view

        return cell_html(first_screen(self), None if self.logs is None else self.plot.time())

    def report(
        self,
        path: str | PathLike[str],
        *,
        truth: LumpedParameters | None = None,
        figures: bool = False,
    ) -> None:
        """Write the identification report: one page that opens offline, numbers beside it.

        Parameters
        ----------
        path
            The file.
        truth
            True parameters, where they are known.
        figures
            Whether to write the figures as PNG and SVG too.

        Raises
        ------
        InputError
            If a file cannot be written, or the logs of a loaded result cannot be read.
        """
        from butterfly.report.identification_page import identification_page  # noqa: PLC0415 - a view
        from butterfly.report.page import write_page  # noqa: PLC0415 - a view

        write_page(identification_page(self, truth), Path(path), figures=figures)


def _fits(content: dict[str, Any]) -> dict[str, float]:
    return {str(name): float(or_nan(fit)) for name, fit in content.items()}
