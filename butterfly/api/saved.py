"""`load`, and the results of `predict` and `draws`."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import partial
from operator import itemgetter
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import ValidationError

from butterfly.api.identification import Identification, IdentifiedModel
from butterfly.api.sources import root_of
from butterfly.arguments import checked
from butterfly.errors import InputError
from butterfly.files import finite, read_file, require_as_signed, whole, write_xml
from butterfly.identification.estimate import Estimate
from butterfly.identification.free_run import FitSummary, WholeRuns, over_segments
from butterfly.identification.predict import OF_NEW_LOG, OF_PARAMETERS, ParameterDraws, Prediction
from butterfly.identification.trust import unit_of
from butterfly.logs.log import InputKind
from butterfly.model.parameters import NO_ADDED_MASS, AddedMass, JointKind, LumpedParameters
from butterfly.model.terms import PARAMETERS, TERMS
from butterfly.outputs import call, require_endings
from butterfly.progress import budget
from butterfly.report.finding_texts import estimate_notes, estimate_verdict
from butterfly.report.format import fit_text
from butterfly.report.inspection import about_log, fit_facts, of_logs
from butterfly.report.numbers import estimate_numbers, write_columns
from butterfly.report.page import Fact, PageTable, views
from butterfly.result import ANSWERS, Answer
from butterfly.twin.forms import DEFAULTS, Options
from butterfly.yaml_files import refusal

if TYPE_CHECKING:
    import control
    import mujoco

_DEFAULTS = {field.name: field.default for field in fields(LumpedParameters)}


class Drawn(Answer):
    """Parameter draws of the bare joint in SI units: one row each, with equal weights."""

    @classmethod
    def of(
        cls, draws: ParameterDraws, identification: Identification, more: Sequence[str]
    ) -> Drawn:
        """Tabulate draws from an identification; ``more`` goes to the summary."""
        estimate, kind = draws.estimate, InputKind(identification.origin["input"])
        fixed = [
            key
            for key, value in estimate.fixed.items()
            if key in PARAMETERS
            or TERMS[key].follows & {*estimate.names}
            or value != _DEFAULTS.get(key)
        ]
        columns = [*estimate.names, *(key for key in fixed if key not in estimate.names)]
        units = {key: unit_of(key, kind, estimate.joint) for key in columns}
        title = f"{len(draws.values)} parameter draws from {identification.title}"
        rows = finite([{key: getattr(draw, key) for key in columns} for draw in draws.parameters])
        facts = [Fact("draws", str(len(rows))), Fact("parameters", str(len(columns)))]
        return cls(
            kind="draws",
            identifications={identification.estimator: identification},
            title=title,
            summary=(*identification.judged.lines, *more, *estimate_notes(estimate)),
            judged=identification.judged,
            units={f"rows.{name}": unit for name, unit in units.items()},
            content={
                "joint": str(estimate.joint),
                "rows": rows,
                **views([PageTable.of(title, rows)], facts, "corner"),
            },
        )

    @property
    def parameters(self) -> list[LumpedParameters]:
        """Each draw as parameters of the bare joint."""
        return [
            LumpedParameters(**{key: value for key, value in row.items() if key in _DEFAULTS})
            for row in self.rows()
        ]

    @checked
    def write(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the draws as CSV, as Parquet (.parquet), or as a folder of MJCF (no ending).

        Column names include units: ``p1 [kg m²]``. The MJCF files are 0000.xml, 0001.xml, ….

        Parameters
        ----------
        path
            File or folder to write.
        overwrite
            Whether to replace an existing CSV file.
        """
        path, rows = Path(path), self.rows()
        require_endings(path, ("", ".csv", ".parquet"))
        if not path.suffix:
            for number, model in enumerate(self.models()):
                write_xml(path / f"{number:04d}.xml", model, "draw")
            return
        names = {key: f"{key} [{self.units[f'rows.{key}']}]" for key in rows[0]}
        with call(overwrite=overwrite):
            write_columns(path, "draws", {names[k]: [row[k] for row in rows] for k in names})

    def models(
        self,
        added_mass: AddedMass = NO_ADDED_MASS,
        *,
        hand_mass: float | None = None,
        timestep: float = DEFAULTS.timestep,
        integrator: Literal["RK4", "implicitfast"] = DEFAULTS.integrator,
    ) -> Iterator[str]:
        """Yield an MJCF model of each draw for plain MuJoCo, for domain randomisation.

        Parameters
        ----------
        added_mass, hand_mass, timestep, integrator
            As in `IdentifiedModel.export`.
        """
        from butterfly.twin.stand_alone import models  # noqa: PLC0415 - slow to import

        drawn = self.parameters
        joint = JointKind(self.content["joint"])
        identified = self.identification
        model = identified.model if identified else IdentifiedModel(drawn[0], joint)
        options = Options(timestep=timestep, integrator=integrator)
        return models(drawn, model.twin(added_mass, hand_mass=hand_mass), options)

    def linear_systems(
        self,
        added_mass: AddedMass = NO_ADDED_MASS,
        *,
        angle: float = 0.0,
        step: float | None = None,
    ) -> list[control.StateSpace]:
        """Return the linearisation of each draw, for robust control.

        Parameters
        ----------
        added_mass, angle
            As in `IdentifiedModel.linearised`.
        step
            Step in s of discrete-time systems (`IdentifiedModel.discretised`). Default: continuous.
        """
        from butterfly.model.control_bridge import discretised, linearised  # noqa: PLC0415 - slow to import

        if step is None:
            return [linearised(draw, added_mass, angle=angle) for draw in self.parameters]
        return [discretised(draw, step, added_mass, angle=angle) for draw in self.parameters]

    def batch(self, added_mass: AddedMass = NO_ADDED_MASS, **how: Any) -> list[mujoco.MjModel]:  # noqa: ANN401 - see `models`
        """Return compiled `models` for ``mujoco.rollout.rollout(batch, data, states)``.

        All have the same state size, whatever their delays. ``how``: options of `models`.
        """
        import mujoco  # noqa: PLC0415 - slow to import

        return [mujoco.MjModel.from_xml_string(text) for text in self.models(added_mass, **how)]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Predicted(Answer):
    """Predicted logs, with 95 % bands."""

    predictions: tuple[Prediction, ...] = ()
    """Free runs and bands; empty for a loaded result."""

    drawn: Drawn | None = None
    """Parameter draws of the bands."""

    @classmethod
    def of(
        cls,
        name: str,
        predictions: Sequence[Prediction],
        more: Sequence[str],
        estimate: Estimate,
        *,
        drawn: Drawn | None,
        measured: bool,
    ) -> Predicted:
        """Tabulate predictions; ``more`` goes to the summary."""
        from butterfly.report.log_figures import with_bands  # noqa: PLC0415 - slow to import

        verdict, log = estimate_verdict(estimate), predictions[0].run.log
        answer, *others = _followed(predictions, estimate.horizon, measured=measured)
        title = f"{name!r} predicted"
        rows = finite([_row(prediction, measured=measured) for prediction in predictions])
        facts = fit_facts(rows, "FIT in %", "of the predictions") if measured else []
        inside = f"{OF_NEW_LOG}: inside in %"
        if shares := [row[inside] for row in rows if row.get(inside) is not None]:
            worst = f"expected: 95 %; worst log {min(shares):.0f} %"
            facts.append(Fact("samples inside the band", f"{np.mean(shares):.1f} %", worst))
        return cls(
            kind="prediction",
            title=title,
            summary=(
                *verdict.after(answer),
                *others,
                *more,
                *estimate_notes(estimate),
            ),
            judged=verdict,
            content={
                "data": {"name": name, "input": str(log.input_kind), "logs": len(predictions)},
                **estimate_numbers(estimate),
                "rows": rows,
                **views(
                    [of_logs(title, rows)],
                    [*facts, Fact("logs", str(len(rows)))],
                    *("inside", "fits"),
                ),
            },
            predictions=tuple(predictions),
            drawn=drawn,
            live=partial(with_bands, predictions, measured) if predictions[0].bands else None,
        )


def _row(prediction: Prediction, *, measured: bool) -> dict[str, Any]:
    run = prediction.run
    way = run.log.unit
    row: dict[str, Any] = {
        **about_log(run.log),
        f"swing in {way}": float(np.ptp(run.simulated)) / 2,
    }
    if measured:
        row["FIT in %"] = run.fit
    for name, band in prediction.bands.items():
        if measured:
            row[f"{name}: inside in %"] = 100 * band.share(prediction.measured)
        row[f"{name}: width in {way}"] = band.width
    return row


def _followed(
    predictions: Sequence[Prediction], horizon: float | None, *, measured: bool
) -> list[str]:
    """State the fit of the logs, and the share of samples inside the bands."""
    count = f"{len(predictions)} logs" if len(predictions) > 1 else "1 log"
    if not measured:
        within = over_segments(horizon)
        longer = f" The model was fitted{within}: a longer run may drift away." if within else ""
        return [f"{count} simulated from rest; there is no measurement to compare with.{longer}"]
    fits = np.array([prediction.run.fit for prediction in predictions])
    whole = WholeRuns.of([(prediction.run.log, prediction.setting) for prediction in predictions])
    fit = FitSummary.of(fits, predictions[0].run.horizon, whole)
    start = "in segments, each from a fitted start" if fit.over else "from the initial angle"
    sentences = [
        f"{count} predicted {start}: median FIT{fit.over} {fit_text(fit.median)} % (mean "
        f"{fit_text(fit.mean)} %, worst {fit_text(fit.worst)} %). {fit.holds}".rstrip()
    ]
    sizes = [prediction.samples.size for prediction in predictions]
    shares = {
        name: [prediction.bands[name].share(prediction.measured) for prediction in predictions]
        for name in predictions[0].bands
    }
    inside = {
        name: 100 * np.average(fractions, weights=sizes) for name, fractions in shares.items()
    }
    if OF_NEW_LOG in inside:
        share, worst = min(zip(shares[OF_NEW_LOG], predictions, strict=True), key=itemgetter(0))
        least = (
            f"; in {worst.run.log.name} {100 * share:.0f} %, the least" if predictions[1:] else ""
        )
        sentences.append(
            f"{inside[OF_NEW_LOG]:.1f} % of the measured samples are inside the band of a new log "
            f"(expected: 95 %){least}."
        )
    if OF_PARAMETERS in inside:
        sentences.append(
            f"{inside[OF_PARAMETERS]:.1f} % are inside the parameter band, which does not include "
            "the model error."
        )
    return sentences


_WITH_MORE: dict[str, type[Answer]] = {
    "draws": Drawn,
    "identification": Identification,
    "prediction": Predicted,
}
"""Answers that can do more than others."""


@checked
def load(path: str | PathLike[str], *, root: str | PathLike[str] | None = None) -> Answer:
    """Load a saved result.

    Parameters
    ----------
    path
        The saved file.
    root
        Folder of the logs, if they were moved without the result.

    Raises
    ------
    InputError
        If the file is damaged, from a newer butterfly, or not a saved result.
    """
    file = Path(path)
    content = read_saved(file)
    schema = content.get("schema")
    kind = schema.removeprefix("butterfly.") if isinstance(schema, str) else ""
    if kind not in ANSWERS:
        expected = "a saved result (--save, or its method save; the JSON of a report is not one)"
        raise InputError(file, "schema", schema, expected)
    number, current = content.get("schema_number"), ANSWERS[kind]
    if number != current:
        newer = isinstance(number, int) and number > current
        remedy = "update butterfly" if newer else "identify and save again with this butterfly"
        raise InputError(file, "schema_number", number, f"{current}: {remedy}")
    try:
        manifest = content.get("data", {}).get("manifest")
        moved = None if root is None else Path(root)
        if manifest is not None and (moved or manifest["root"]) is not None:
            manifest["root"] = str(root_of(file, manifest["root"], moved))
        with budget(math.inf):  # loading is complete, even while a search has a time limit
            answer = answer_of(content)
            answer.tables(), answer.facts(), answer.printed()
    except ValidationError as error:
        raise refusal(error, file, whole=_UNDAMAGED) from None
    except (LookupError, TypeError, ValueError, AttributeError, StopIteration) as error:
        problem = f"{type(error).__name__}: {error}"
        raise InputError(file, "content", problem, _UNDAMAGED) from None
    return answer


_UNDAMAGED = "an undamaged saved result"


def answer_of(content: dict[str, Any], **more: Any) -> Answer:  # noqa: ANN401 - other fields
    """Return the answer of a document; ``more``: fields of `Answer` that are not saved.

    Raises as `Answer.from_dict` and `Estimate.from_dict` do.
    """
    of_logs = (entry for entry in content.get("estimates", ()) if "fits" in entry)
    if identified := {entry["estimator"]: Identification.from_dict(entry) for entry in of_logs}:
        more["identifications"] = identified
    kind = content["schema"].removeprefix("butterfly.")
    return _WITH_MORE.get(kind, Answer).from_dict(content, **more)


def kind_of(file: Path) -> str:
    """Return the kind of answer that a file seems to hold; empty if none."""
    try:
        schema = json.loads(file.read_bytes())["schema"]
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return ""
    kind = str(schema).removeprefix("butterfly.")
    return kind if kind in ANSWERS else ""


def read_saved(file: Path) -> dict[str, Any]:
    """Return the content of a saved result; InputError if it is none, or damaged."""
    with whole(file, "a saved result"):
        text = read_file(file, "a saved result").decode()
        content = json.loads(text)
    if not isinstance(content, dict):
        raise InputError(file, "content", type(content).__name__, "a saved result")
    require_as_signed(file, text, content, _UNDAMAGED)
    return content
