"""An identification that shows, saves and reports itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from butterfly.api.identified_model import IdentifiedModel
from butterfly.api.identified_plots import IdentifiedPlots
from butterfly.api.result import Result, TextTable, aligned, text, texts
from butterfly.api.separated import Separated
from butterfly.api.usable import require_possible
from butterfly.errors import InputError
from butterfly.identification.data import DataSet, read_data_set
from butterfly.identification.diagnostics.unit_errors.names import listed
from butterfly.identification.estimate import Estimate
from butterfly.identification.estimators import Estimator
from butterfly.identification.free_run import FitSummary
from butterfly.identification.identification import Identification, simulated
from butterfly.identification.parameter import or_nan
from butterfly.identification.physical import PhysicalParameters, physical_parameters
from butterfly.logs.log import InputKind
from butterfly.logs.manifest import Manifest
from butterfly.model.known import PHYSICAL, Knowledge
from butterfly.model.parameters import (
    GRAVITY,
    NO_ADDED_MASS,
    AddedMass,
    JointKind,
    LumpedParameters,
)
from butterfly.report.finding_texts import estimate_sentences, estimate_verdict
from butterfly.report.format import fit_text
from butterfly.report.identification import write_report
from butterfly.report.numbers.document import Told
from butterfly.report.numbers.estimate_numbers import chosen_numbers
from butterfly.report.numbers.identification_numbers import (
    BESIDES,
    besides_of,
    origin_of,
    titled,
    told_of_parts,
)
from butterfly.report.parameter_table import parameter_rows
from butterfly.report.physical import HEADERS as PHYSICAL_HEADERS
from butterfly.report.physical import TITLE as PHYSICAL_TITLE
from butterfly.report.physical import physical_rows, physical_sentences
from butterfly.report.summary import summary
from butterfly.verdict import Verdict

if TYPE_CHECKING:
    import control
    from plotly.graph_objects import Figure

_HEADERS = (
    *("", "true", "deviation", "estimate", "std error", "95 % interval", "unit"),
    "one mass left out",
)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Identified(Result):
    """What was learnt from a data set.

    Parameters
    ----------
    estimate
        Parameters with covariance and findings.
    estimator
        What made it, and what that was told.
    origin
        The data: name, description, input, number of logs, what was known of the robot, its joint
        and gravity, and the manifest that the logs were read by.
    fits
        FIT in per cent of the free run of each log, by its name.
    summary
        What was found, in words.
    held_out
        FIT in per cent of each log that was held out, by its name.
    saved
        What a file told of it that its logs are needed for (see `besides_of`).
    live
        The identification with its logs; None for one that was loaded.
    """

    kind: ClassVar[str] = "identification"

    estimate: Estimate
    estimator: str
    origin: dict[str, Any]
    fits: dict[str, float]
    summary: tuple[str, ...]
    held_out: dict[str, float] = field(default_factory=dict)
    saved: dict[str, Any] = field(default_factory=dict)
    live: Identification | None = None

    @classmethod
    def of(cls, found: Identification, estimator: str) -> Identified:
        """Wrap an identification made by an estimator of this label."""
        return cls(
            estimate=found.estimate,
            estimator=estimator,
            origin=origin_of(found),
            fits={run.log.name: run.fit for run in found.free_runs},
            summary=tuple(summary(found)),
            held_out=found.held_out,
            live=found,
        )

    @classmethod
    def of_content(cls, content: dict[str, Any]) -> Identified:
        """Return what `to_dict` told of (see `Estimate.from_dict` for what is raised)."""
        origin = dict(content["data"])
        InputKind(origin["input"])
        if origin["manifest"] is not None:
            manifest = origin["manifest"]
            Manifest.model_validate({**manifest, "root": manifest["root"] or "."})
        result = cls(
            estimate=_usable(Estimate.from_dict(content)),
            estimator=text(content["estimator"]),
            origin=origin | {"name": text(origin["name"])},
            fits=_some(_fits(content["fits"])),
            summary=texts(content["summary"]),
            held_out=_fits(content.get("held_out", {})),
            saved={key: content[key] for key in BESIDES if key in content},
        )
        result.physical()
        return result

    def told(self) -> Told:
        """Return what it says, for programs."""
        return told_of_parts(
            estimate=self.estimate,
            label=self.estimator,
            origin=self.origin,
            fits=self.fits,
            held_out=self.held_out,
            said=self.summary,
            physical=self._physical(),
            besides=self._besides,
        )

    @property
    def _besides(self) -> dict[str, Any]:
        if self.live is not None:
            return besides_of(self.live)
        return {"chosen": chosen_numbers(None, self.estimate, self.estimator)} | self.saved

    def kept(self, folder: Path) -> dict[str, Any]:
        """Return what `save` writes: besides all the rest, where the logs lie.

        That is relative to the folder of the file, if they lie below.
        """
        document, manifest = self.to_dict(), self.origin["manifest"]
        if manifest is None or manifest["root"] is None:
            return document
        root = Path(manifest["root"])
        said = root.relative_to(folder).as_posix() if root.is_relative_to(folder) else str(root)
        document["data"]["manifest"]["root"] = said
        return document

    @property
    def title(self) -> str:  # type: ignore[override]
        """Method, data, and the FIT."""
        return titled(self.estimator, self.origin["name"], self.fit)

    def rows(self) -> list[dict[str, Any]]:
        """Return a row for each parameter: value, standard error, 95 % interval, unit."""
        shown = ("value", "standard_error", "lower", "upper", "unit")
        return [
            {"parameter": each.name, **{name: getattr(each, name) for name in shown}}
            for each in self.estimate.table()
        ]

    def shown_rows(self) -> list[dict[str, str]]:
        """Return the table of parameters with the digits that their errors leave."""
        return [
            {
                "parameter": row.symbol,
                "value": row.value,
                "standard error": row.error,
                "95 % interval": row.interval,
                "unit": row.unit,
            }
            for row in parameter_rows(self.estimate.table())
        ]

    def tables(self, truth: LumpedParameters | None = None) -> list[TextTable]:
        """Return parameters beside the true ones if known, physical ones, and FIT of others."""
        rows = [
            (
                *(row.symbol, row.true, row.deviation, row.value, row.error, row.interval),
                *(row.unit, row.left_out),
            )
            for row in parameter_rows(self.estimate.table(truth))
        ]
        name = f"{self.origin['name']}: {self.estimate.method}"
        tables = [TextTable(name, _HEADERS, rows)]
        if physical := physical_rows(self._physical()) if self._weighed else []:
            tables.append(TextTable(PHYSICAL_TITLE, PHYSICAL_HEADERS, physical))
        if self.estimate.resonances:
            found = [(str(mass), f"{w:.4f}") for mass, w in self.estimate.resonances.items()]
            tables.append(TextTable("Resonance, as this method finds it", ("", "rad/s"), found))
        if self.live is not None and self.live.comparisons:
            tables.append(_comparisons(self.live))
        return tables

    def paragraphs(self) -> list[str]:
        """Return the summary, and what is open of the physical parameters if any are known."""
        return [*self.summary, *(physical_sentences(self._physical()) if self._weighed else ())]

    @property
    def _weighed(self) -> bool:
        return bool(Knowledge.told(self.origin.get("known", {})).physical)

    def shown_lines(self) -> list[str]:
        """Return the table of parameters as lines."""
        return aligned(self.shown_rows())

    def __repr__(self) -> str:
        pairs = zip(self.estimate.names, self.estimate.values, strict=True)
        values = ", ".join(f"{name} {value:.4g}" for name, value in pairs)
        return f"<Identified: {self.title}{self._unless_good()}: {values}>"

    @property
    def judged(self) -> Verdict:  # type: ignore[override]
        """The verdict on its values."""
        return estimate_verdict(self.estimate)

    @property
    def _joint(self) -> JointKind:
        return JointKind(self.origin.get("joint", JointKind.HINGE))

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
        require_possible(self.estimate)
        return IdentifiedModel(self.parameters, self._joint)

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(n, n), in the order of `rows`."""
        return self.estimate.covariance

    @property
    def verdict(self) -> list[str]:
        """How far to trust the values, in words: first what may be done with them."""
        return estimate_sentences(self.estimate)

    def physical(self, **known: Any) -> Separated:  # noqa: ANN401 - see `known_of`
        """Tell what the lumped parameters are made of, as far as it can be told.

        Parameters
        ----------
        known
            What is known of motor and hand besides what the data say of it, by names of
            `butterfly.model.known.PHYSICAL`: a number, or ``(0.3, 0.01)`` with its uncertainty.

        Raises
        ------
        InputError
            If it is none of these, or was known before.
        """
        return Separated.of(self._physical(known), self.origin["name"], self.judged)

    def _physical(self, known: Mapping[str, Any] = MappingProxyType({})) -> PhysicalParameters:
        before, told = Knowledge.told(self.origin.get("known", {})), Knowledge.told(known)
        for name in known:
            if name not in told.physical:
                raise InputError("physical", name, "no part of motor or hand", listed([*PHYSICAL]))
            if name in before.physical:
                expected = "what was not known before; else identify again with it"
                raise InputError("physical", name, known[name], expected)
        carrier = AddedMass(
            gravity=float(self.origin.get("gravity", GRAVITY)),
            joint=self._joint,
        )
        kind = InputKind(self.origin["input"])
        return physical_parameters(self.estimate, before.also(told), kind, carrier)

    @property
    def fit(self) -> FitSummary:
        """Median, mean and worst FIT in per cent."""
        return FitSummary.of(np.array(list(self.fits.values())), self.estimate.horizon)

    @property
    def data(self) -> DataSet:
        """The logs; of a loaded result they are read again from where they were.

        Raises
        ------
        InputError
            If it is not known where they are, or they cannot be read.
        """
        return self._identification.data

    def measured(self, added_mass: AddedMass = NO_ADDED_MASS) -> control.FrequencyResponseData:
        """Return the responses measured with an added mass, beside `model.linearised` with it.

        Parameters
        ----------
        added_mass
            One of ``data.masses``; none if not given.

        Raises
        ------
        InputError
            If no sine was logged with it.
        """
        from butterfly.signals.measured_response import measured_response  # noqa: PLC0415 - slow

        return measured_response(self.data.sines, added_mass)

    @property
    def made_by(self) -> Estimator | None:
        """The estimator; None of a result that was loaded."""
        return None if self.live is None else self.live.estimator

    @property
    def plot(self) -> IdentifiedPlots:
        """Its figures, as plotly's."""
        return IdentifiedPlots(self._identification)

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page, by name."""
        return {"frequency-response": self.plot.frequency_response(), "time": self.plot.time()}

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
        write_report(self._identification, Path(path), truth, figures=figures)

    @cached_property
    def _identification(self) -> Identification:
        if self.live is not None:
            return self.live
        found = self.origin["manifest"]
        if found is None or found["root"] is None:
            expected = "one whose logs came from one source of files, to be read again"
            raise InputError("a result that was loaded", "logs", "none", expected)
        return simulated(read_data_set(Manifest.model_validate(found)), self.estimate)


def _comparisons(found: Identification) -> TextTable:
    """Return FIT of this identification, and of the parameters that it was compared with."""
    fits = [(f"{found.estimate.method}, this identification", found.summary)]
    for other in found.comparisons:
        gain = f" (best p4: {other.parameters.p4:.4g})" if other.gain_fitted else ""
        fits.append((other.name + gain, other.summary))
    return TextTable(
        f"FIT in %{found.summary.over} on the same logs",
        ("parameters", "median", "mean", "worst"),
        [(name, *map(fit_text, (fit.median, fit.mean, fit.worst))) for name, fit in fits],
    )


def _fits(content: dict[str, Any]) -> dict[str, float]:
    return {str(name): float(or_nan(fit)) for name, fit in content.items()}


def _some(fits: dict[str, float]) -> dict[str, float]:
    if not fits:
        raise ValueError("no logs")
    return fits


_LARGEST = 1e60  # of any number: squares of such are numbers too


def _usable(estimate: Estimate) -> Estimate:
    """Return an estimate that results can be made of; a ValueError says why it is none."""
    arrays = (estimate.values, *estimate.left_out.values(), *estimate.rivals)
    if not all(np.isfinite(each).all() for each in arrays):
        raise ValueError("values that are no numbers")
    others = (estimate.covariance, estimate.lower, estimate.upper, np.array(estimate.condition))
    if any((np.abs(each) > _LARGEST).any() for each in (*arrays, *others)):
        raise ValueError(f"numbers above {_LARGEST:g}")
    return estimate
