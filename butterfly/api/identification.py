"""The result of `identify`, and the identified model for control and export."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from butterfly.api.joint_models import of_joint
from butterfly.arguments import checked
from butterfly.errors import InputError, visible
from butterfly.files import finite, write_document
from butterfly.identification.data import DataSet
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import WholeRuns
from butterfly.identification.identified import Identified
from butterfly.identification.residuals import residual_units
from butterfly.identification.trust import or_nan
from butterfly.logs.log import InputKind, Log
from butterfly.logs.manifest import Manifest
from butterfly.model.linear import LinearJoint, resonance_frequency
from butterfly.model.parameters import (
    GRAVITY,
    NO_ADDED_MASS,
    AddedMass,
    JointKind,
    LumpedParameters,
)
from butterfly.model.prior import Prior
from butterfly.outputs import call
from butterfly.report.finding_texts import estimate_sentences, estimate_verdict, require_values
from butterfly.report.format import fit_text
from butterfly.report.numbers import (
    chosen_options,
    estimate_numbers,
    finding_numbers,
    residual_numbers,
)
from butterfly.report.page import Fact, Page, PageTable, Section, views
from butterfly.report.parameter_table import (
    PHYSICAL_TITLE,
    parameter_table,
    physical_numbers,
    physical_sentences,
)
from butterfly.report.summary import facts, summary, tables
from butterfly.result import Answer, document, text, texts
from butterfly.twin.forms import DEFAULTS, Options
from butterfly.twin.model_rows import model_rows
from butterfly.verdict import Verdict

if TYPE_CHECKING:
    import control
    import mujoco
    from plotly.graph_objects import Figure

    from butterfly.report.identification_figures import IdentificationPlots
    from butterfly.twin.twin import Twin, Written
    from butterfly.twin.written_back import WrittenBack

_UNITS = {"fit.horizon": "s", "fit.longest": "s", "zeros": "rad"} | dict.fromkeys(
    ("fit", "fits", "velocity_fits", "held_out", "open_loop_fits", "against.fit"), "%"
)
_OF_LOGS = (
    "fits",
    "velocity_fits",
    "held_out",
    "mean_errors",
    "open_loop_fits",
    "zeros",
)  # by name
_SAVED = ("summary", "chosen", "against", "residuals")


class Identification(Identified, Answer):
    """Data, estimate and what follows from them, which is computed when it is asked for."""

    kind = "identification"

    @classmethod
    def of(cls, identified: Identified) -> Identification:
        """Return the same with its answer: both have one state, and what either looks up."""
        answer = object.__new__(cls)
        object.__setattr__(answer, "__dict__", vars(identified))
        return answer

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], **more: Any) -> Self:  # noqa: ANN401 - fields
        """Return the result of `to_dict`'s values (see `Estimate.from_dict` for what is raised)."""
        origin = dict(content["data"])
        InputKind(origin["input"])
        JointKind(origin.get("joint", JointKind.HINGE))
        float(origin.get("gravity", GRAVITY))
        int(origin["logs"])
        if origin["manifest"] is not None:
            manifest = origin["manifest"]
            Manifest.model_validate({**manifest, "root": manifest["root"] or "."})
        texts(content["summary"])
        if not content["fits"]:
            raise ValueError("no logs")
        of_logs: dict[str, Any] = {name: _fits(content.get(name, {})) for name in _OF_LOGS}
        true = {name: parameter["value"] for name, parameter in content.get("truth", {}).items()}
        result = cls(
            estimate=Estimate.from_dict(content).usable,
            estimator=text(content["estimator"]),
            origin=origin | {"name": text(origin["name"])},
            **of_logs,
            whole=_whole(content["fit"]),
            truth=LumpedParameters(**true) if true else None,
            saved={key: content[key] for key in _SAVED if key in content},
            **more,
        )
        result.separated()  # these three raise where a file names something that it does not hold
        finding_numbers(result.estimate.findings, result.estimate)
        estimate_sentences(result.estimate)
        return result

    def to_dict(self) -> dict[str, Any]:
        """Return the result as a JSON document, with the true values if known (see `Answer`)."""
        estimate, basis, in_model = self.estimate, self.basis(), model_rows(self)
        of_logs = {key: value for key, value in self.saved.items() if key != "summary"}
        if self.logs is not None:
            of_logs = {
                "against": [comparison.numbers(estimate) for comparison in self.comparisons],
                "residuals": residual_numbers(self.residuals, estimate),
            }
        return document(
            self.kind,
            self.title,
            {
                "estimator": self.estimator,
                "data": basis["data"],
                **estimate_numbers(estimate, self.truth),
                "fit": self.fit.numbers(),
                **{name: getattr(self, name) for name in _OF_LOGS},
                "physical": physical_numbers(self.separated()),
                **({"model": [row.numbers() for row in in_model]} if in_model else {}),
                "chosen": basis["chosen"],
                **of_logs,
            },
            verdict=self.judged,
            summary=self.summary,
            units=_UNITS | residual_units(estimate.joint) | {"mean_errors": estimate.joint.way},
        )

    @checked
    def save(self, path: str | PathLike[str]) -> None:
        """Write the result as JSON for `butterfly.load`, with the folder of its logs.

        The folder is written relative to that of the file if it lies below.
        """
        content, manifest = self.to_dict(), self.origin["manifest"]
        folder = Path(path).resolve().parent
        if manifest is not None and manifest["root"] is not None:
            root = Path(manifest["root"])
            root = root.relative_to(folder) if root.is_relative_to(folder) else root
            content["data"]["manifest"] |= {"root": root.as_posix(), "model": manifest["model"]}
        schema = content.pop("schema")
        write_document({"schema": schema, "saved": True, **content}, Path(path), sign=True)

    def basis(self) -> dict[str, Any]:
        """Return the data and options that it rests on, without the place of its logs."""
        manifest = self.origin["manifest"]
        chosen = chosen_options(self.made_by, self.estimate, self.estimator)
        return {
            "data": {
                **self.origin,
                "manifest": manifest and {**manifest, "root": None, **_named_model(manifest)},
            },
            "chosen": self.saved.get("chosen", chosen),
        }

    @cached_property
    def data(self) -> DataSet:
        """The logs, read again if it was loaded; InputError if they cannot be."""
        return super().data if self.logs is not None else of_joint(super().data)

    @property
    def title(self) -> str:
        """Method, data, and the FIT."""
        fit, name = self.fit, self.origin["name"]
        return f"{self.estimator} of {name!r}, median FIT{fit.over} {fit_text(fit.median)} %"

    @cached_property
    def summary(self) -> tuple[str, ...]:
        """The verdict, then all that was found, gravest first."""
        return tuple(self.saved["summary"] if self.logs is None else summary(self))

    def rows(self) -> list[dict[str, Any]]:
        """Return a row for each parameter: value, standard error, 95 % interval, unit."""
        columns = ("value", "standard_error", "lower", "upper", "unit")
        return [
            {"parameter": parameter.name, **{name: getattr(parameter, name) for name in columns}}
            for parameter in self.estimate.table()
        ]

    def printed(self) -> PageTable:
        """Return the table of parameters, rounded to their errors."""
        columns = ("parameter", "value", "standard error", "95 % interval", "unit", "meaning")
        return parameter_table(self.title, self.estimate.table(), *columns)

    def tables(self) -> list[PageTable]:
        """Return the tables: parameters (beside the truth if known), physical ones, other FITs."""
        return tables(self)

    def paragraphs(self) -> list[str]:
        """Return the summary; if physical parameters were given, also which remain unknown."""
        weighed = Prior.of(self.origin.get("known", {})).physical
        return [*self.summary, *(physical_sentences(self.separated()) if weighed else ())]

    def __repr__(self) -> str:
        estimate = self.estimate
        entries = {n: f"{value:.4g}" for n, value in estimate.named.items()}
        entries |= dict.fromkeys(estimate.open, "open")
        values = ", ".join(f"{n} {value}" for n, value in entries.items())
        return visible(f"<Identification: {self.title}{self._unless_good()}: {values}>")

    @property
    def judged(self) -> Verdict:
        """The verdict on its values."""
        return estimate_verdict(self.estimate)

    @property
    def model(self) -> IdentifiedModel:
        """The joint with the identified parameters."""
        require_values(self.estimate, "a model of the joint")
        return IdentifiedModel(self.parameters, self.estimate.joint, self)

    def physical(self, **known: Any) -> Answer:  # noqa: ANN401 - see `known_of`
        """Separate the lumped parameters into physical ones, as far as they are identifiable.

        Parameters
        ----------
        known
            Known values of motor and hand besides those of the data, by names of
            `butterfly.model.prior.PHYSICAL`: a number, or ``(0.3, 0.01)`` with its uncertainty.
        """
        parameters, title = self.separated(known), f"{PHYSICAL_TITLE} of {self.origin['name']!r}"
        numbers = physical_numbers(parameters)
        rows = finite([{"parameter": name} | row for name, row in numbers.items()])
        return Answer(
            kind="physical",
            title=title,
            summary=(*self.judged.lines, *physical_sentences(parameters)),
            content={"rows": rows, **views([PageTable.of(title, rows)])},
            judged=self.judged,
        )

    @checked
    def write_back(
        self,
        model: str | PathLike[str],
        path: str | PathLike[str],
        *,
        others: Sequence[Identified] = (),
        overwrite: bool = False,
    ) -> WrittenBack:
        """Write what was identified into a copy of the robot's own MJCF or URDF.

        Only attributes whose value in the file lies outside their interval change; every other
        byte of the text stays. The written model is then simulated with the logs.

        Parameters
        ----------
        model
            The robot's file, which is never written.
        path
            The file to write.
        others
            Results of further joints, to be written into the same file.
        overwrite
            Whether an existing file may be replaced.

        Raises
        ------
        InputError
            If identified without ``model=`` and ``of=``, or if the file cannot be read or written.
        """
        from butterfly.twin.written_back import write_back  # noqa: PLC0415 - slow to import

        results = (self, *others)
        for result in results:
            require_values(result.estimate, "a model of the robot")
        return write_back(results, Path(model), Path(path), overwrite=overwrite)

    @property
    def plot(self) -> IdentificationPlots:
        """Its figures, as plotly's."""
        from butterfly.report.identification_figures import IdentificationPlots  # noqa: PLC0415 - slow to import

        return IdentificationPlots(self)

    def figures(self) -> dict[str, Figure]:
        """Return the figures of its page, by name."""
        of_logs = {"frequency-response": self.plot.frequency_response(), "time": self.plot.time()}
        corner = self.plot.corner()
        return of_logs if corner is None else of_logs | {"corner": corner}

    def facts(self) -> list[Fact]:
        """Return the numbers that matter most."""
        return facts(self, self.to_dict())

    def _repr_html_(self) -> str:
        from butterfly.report.identification_page import first_screen  # noqa: PLC0415 - slow to import
        from butterfly.report.page import cell_html  # noqa: PLC0415 - slow to import

        screen = first_screen(self, self.facts())
        figure = None if self.logs is None else self.plot.time()
        return cell_html(screen, self.first_lines, figure)

    @checked
    def report(
        self, path: str | PathLike[str], *, figures: bool = False, numbers: bool = True
    ) -> None:
        """Write the page, as `Answer.report` does; its figures need the logs."""
        if figures:
            _ = self.data  # raises where there is nothing to draw
        super().report(path, figures=figures, numbers=numbers)

    def page(self) -> Page:
        """Return the page of `report`: without the logs, its first screen and tables."""
        from butterfly.report.identification_page import (  # noqa: PLC0415 - slow to import
            corner_sections,
            first_screen,
            identification_page,
        )

        numbers, facts = self.to_dict(), self.facts()
        try:
            _ = self.data
        except InputError as error:
            note = f"Without figures of the logs, which cannot be read ({error})."
        else:
            return identification_page(self, self.notes, facts, numbers)
        tables = [Section(title=t.title, tables=(t.on_page(),)) for t in self.tables()[1:]]
        sections = [*corner_sections(self), *tables]
        first = first_screen(self, facts)
        return replace(first, summary=[note, *self.notes], sections=sections, numbers=numbers)


@dataclass(frozen=True)
class IdentifiedModel:
    """The identified joint: p1 thdd + p2 thd + p3 sin th = p4 u and further terms."""

    parameters: LumpedParameters
    """Parameters of the bare joint in SI units."""

    joint: JointKind = JointKind.HINGE
    """Hinge or slide."""

    identified: Identified | None = field(default=None, repr=False, compare=False)
    """What was learnt of it; None for plain parameters."""

    def with_added_mass(self, added_mass: AddedMass) -> LumpedParameters:
        """Return the parameters with an added mass (78)."""
        return self.parameters.with_added_mass(added_mass)

    def linearised(
        self, added_mass: AddedMass = NO_ADDED_MASS, *, angle: float = 0.0, pade_order: int = 4
    ) -> control.StateSpace:
        """Return the linearisation at rest at an angle in rad, from command to angle and velocity.

        Includes the armature's lag and a Padé approximation of the delay, without Coulomb friction.
        With order 0 or a negative delay the delay is omitted, and the system is named
        ``hand_without_delay`` (see `butterfly.model.control_bridge.linearised`).
        """
        from butterfly.model.control_bridge import linearised  # noqa: PLC0415 - slow to import

        return linearised(self.parameters, added_mass, angle=angle, pade_order=pade_order)

    def discretised(
        self, step: float, added_mass: AddedMass = NO_ADDED_MASS, *, angle: float = 0.0
    ) -> control.StateSpace:
        """Return the zero-order-hold discretisation at a step in s, with the exact delay.

        Earlier commands are states (see `butterfly.model.control_bridge.discretised`).
        """
        from butterfly.model.control_bridge import discretised  # noqa: PLC0415 - slow to import

        return discretised(self.parameters, step, added_mass, angle=angle)

    def nonlinear(self, added_mass: AddedMass = NO_ADDED_MASS) -> control.NonlinearIOSystem:
        """Return the nonlinear equation for python-control, without the delay."""
        from butterfly.model.control_bridge import nonlinear_system  # noqa: PLC0415 - slow to import

        return nonlinear_system(self.with_added_mass(added_mass))

    def frequency_response(
        self, omega: ArrayLike, added_mass: AddedMass = NO_ADDED_MASS
    ) -> NDArray[np.complex128]:
        """G(jw) of the linearisation (13) in rad per unit of input, at frequencies in rad/s."""
        return LinearJoint.of(self.with_added_mass(added_mass)).response(omega)

    def resonance(self, added_mass: AddedMass = NO_ADDED_MASS) -> float:
        """Return the resonance frequency of the linearisation in rad/s; 0 without a peak."""
        return resonance_frequency(self.with_added_mass(added_mass))

    def simulate(self, log: Log, *, zero: float = 0.0, velocity: float | None = None) -> Log:
        """Simulate a log from its initial angle with its input (free run).

        Parameters
        ----------
        log
            Log whose input, added mass and initial angle are used.
        zero
            Encoder reading in rad with the joint hanging at rest.
        velocity
            Initial velocity in rad/s. Default: from the log's first samples.
        """
        from butterfly.identification.free_run import FreeRun, Setting  # noqa: PLC0415 - slow to import

        run = FreeRun.of(log, Setting(parameters=self.parameters, zero=zero, velocity=velocity))
        return replace(log.with_measurement(run.simulated), source="grey-box model")

    def twin(
        self, added_mass: AddedMass = NO_ADDED_MASS, *, hand_mass: float | None = None
    ) -> Twin:
        """Return the twin: the joint to export, with logs to check its accuracy."""
        from butterfly.twin.twin import Twin  # noqa: PLC0415 - slow to import

        if self.identified is not None:
            return Twin.identified(self.identified, added_mass, hand_mass)
        return Twin(parameters=self.parameters, added=added_mass, joint=self.joint, mass=hand_mass)

    def export(
        self,
        path: str | PathLike[str],
        added_mass: AddedMass = NO_ADDED_MASS,
        *,
        to: str = "mjcf",
        hand_mass: float | None = None,
        timestep: float = DEFAULTS.timestep,
        integrator: Literal["RK4", "implicitfast"] = DEFAULTS.integrator,
        others: Sequence[Identification] = (),
        overwrite: bool = False,
    ) -> Written:
        """Export the joint (its twin), as ``butterfly export`` does.

        Returns the text, and its error against our own simulation. Warns of everything that the
        format cannot represent; the file says so too.

        Parameters
        ----------
        to
            Format, one of `butterfly.twin.forms.FORMS`.
        hand_mass
            Mass of the moving body in kg; the motion does not depend on it. Default: chosen.
        timestep
            Time step of your simulator in s.
        integrator
            MuJoCo integrator.
        others
            Results of further units of the joint, whose scatter ``to="randomisation"`` writes.
        overwrite
            Whether to replace an existing file that does not show who wrote it: C, Python, JSON.
        """
        from butterfly.twin.forms import write_twin  # noqa: PLC0415 - slow to import

        if others and to != "randomisation":
            raise InputError("export", "others", f"{len(others)} results", 'to="randomisation"')
        units = tuple(other.model.twin(added_mass) for other in others)
        options = Options(timestep=timestep, integrator=integrator, units=units)
        with call(overwrite=overwrite):
            twin = self.twin(added_mass, hand_mass=hand_mass)
            written = write_twin(to, twin, options, Path(path))
        for sentence in written.left_out:
            warnings.warn(sentence, stacklevel=2)
        return written

    def mjspec(
        self,
        added_mass: AddedMass = NO_ADDED_MASS,
        *,
        hand_mass: float | None = None,
        timestep: float = DEFAULTS.timestep,
        integrator: Literal["RK4", "implicitfast"] = DEFAULTS.integrator,
    ) -> mujoco.MjSpec:
        """Return the joint as an MjSpec, to attach to your robot.

        Example: ``robot.attach(result.model.mjspec(), frame=frame, prefix="wrist_")``. Includes
        body, joint, actuators and sensors, without light, floor and camera. Options are those of
        `export`: use the robot's time step and integrator.
        """
        import mujoco  # noqa: PLC0415 - slow to import

        from butterfly.plant.mjcf import text_of  # noqa: PLC0415
        from butterfly.twin.stand_alone import stand_alone  # noqa: PLC0415

        options = Options(timestep=timestep, integrator=integrator)
        root = stand_alone(self.twin(added_mass, hand_mass=hand_mass), options).root
        return mujoco.MjSpec.from_string(text_of(root))


def _named_model(manifest: Mapping[str, Any]) -> dict[str, str]:
    """Return the name of a manifest's model, without its place; nothing without a model."""
    path = manifest.get("model")
    return {"model": Path(path).name} if path else {}


def _whole(fit: dict[str, Any]) -> WholeRuns | None:
    longest = fit.get("longest")
    return None if longest is None else WholeRuns(or_nan(fit.get("whole")), float(longest))


def _fits(content: dict[str, Any]) -> dict[str, float]:
    return {str(name): float(or_nan(fit)) for name, fit in content.items()}
