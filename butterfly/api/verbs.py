"""What `import butterfly as bf` can do: read, identify, simulate, validate, design, compare."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from butterfly.api.identified import Identified
from butterfly.api.tabulated import Compared, Designed, Validated
from butterfly.compare.three_way import compare_three
from butterfly.errors import InputError
from butterfly.experiment.data_source import manifest_of, named_data
from butterfly.experiment.estimator_spec import make_estimator
from butterfly.experiment.methods import DEFAULT_METHOD
from butterfly.experiment.reading import read_experiment
from butterfly.experiment.simulation import simulate as simulated_logs
from butterfly.experiment.simulation import write_logs
from butterfly.identify.data import DataSet, read_data_set
from butterfly.identify.design import LARGEST_SWING, next_experiments
from butterfly.identify.identification import identify as identify_data
from butterfly.identify.judgement.validation import Split, hold_out
from butterfly.logs.log import InputKind, Intersample, Log
from butterfly.logs.manifest import read_entry, read_manifest
from butterfly.model.parameters import LumpedParameters
from butterfly.plant.twin import MASS
from butterfly.resources import locate

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from butterfly.experiment.schema import Experiment
    from butterfly.identify.estimators import Estimator

    Named = str | PathLike[str]
    Data = DataSet | Log | Named | Sequence[Log | Named]
    Method = str | Estimator


def read(
    source: Data,
    *,
    root: Named | None = None,
    arm: float | None = None,
    input_kind: str = InputKind.VOLTAGE,
    intersample: str = Intersample.ZERO_ORDER_HOLD,
    columns: Mapping[str, str] | None = None,
    name: str = "logs",
) -> DataSet:
    """Read logs, check them, repair what may be repaired, and fit the steady response of sines.

    Parameters
    ----------
    source
        A manifest; a folder with one, or with logs named like Data_52__8__002.mat; a log file; a
        saved result; the name of a shipped data set; a `Log`; or several logs or log files.
    root
        Folder of the logs, if not the one that the manifest names.
    arm
        Pivot to added mass in m, where no manifest says it.
    input_kind, intersample, columns
        What the input commands (``voltage`` or ``torque``), how it is held (``zero_order_hold`` or
        ``first_order_hold``), and the columns of a .csv file (``time``, ``input``, ``angle``),
        where no manifest says so.
    name
        Of the data set, where several logs are put together.

    Raises
    ------
    InputError
        Naming file, field, value and what was expected.
    """
    if isinstance(source, DataSet):
        return source
    about: dict[str, Any] = {
        "root": None if root is None else Path(root),
        "arm": arm,
        "input_kind": _kind(InputKind, "input_kind", input_kind),
        "intersample": _kind(Intersample, "intersample", intersample),
        "columns": columns,
    }
    if isinstance(source, Log):
        return DataSet.of([source], name=source.name or name)
    if isinstance(source, str | PathLike):
        return named_data(Path(source), **about)
    logs: list[Log] = []
    for each in source:
        if isinstance(each, Log):
            logs.append(each)
            continue
        manifest = manifest_of(Path(each), **about)
        logs.extend(read_entry(manifest, entry) for entry in manifest.logs)
    return DataSet.of(logs, name=name)


def identify(
    data: Data,
    method: Method = DEFAULT_METHOD,
    *,
    against: Mapping[str, LumpedParameters | Mapping[str, float]] | None = None,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Identified:
    """Identify the robot that made the logs.

    Parameters
    ----------
    data
        What `read` takes, or has read.
    method
        ``harmonic-balance``, ``output-error``, ``weak-form``, ``linear``, ``thesis``, or an
        estimator.
    against
        Other parameters to simulate the logs with, by name; without p4 the best one is used.
    options
        Of the method, as `butterfly identify --help` names them: ``terms=("drag",)``, ...

    Raises
    ------
    InputError
        If the logs cannot be used, or an option is not the method's.
    IdentifiabilityError
        If they cannot determine the parameters.
    """
    estimator = make_estimator(method, options)
    others = {name: _parameters(name, given) for name, given in (against or {}).items()}
    found = identify_data(read(data), estimator, against=others)
    return Identified.of(found, estimator.label)


def simulate(experiment: Named | Experiment, *, out: Named | None = None) -> DataSet:
    """Simulate an experiment in MuJoCo, and return its logs.

    Parameters
    ----------
    experiment
        A file, the name of a shipped one, or what `read_experiment` returned.
    out
        Folder to which the logs are written with their manifest, in the form of the real ones.

    Raises
    ------
    InputError
        If the experiment is not one, or a simulation diverges.
    """
    plan = (
        read_experiment(locate(Path(experiment)))
        if isinstance(experiment, str | PathLike)
        else experiment
    )
    logs = list(simulated_logs(plan))
    if out is not None:
        return read_data_set(read_manifest(write_logs(plan, logs, Path(out))))
    return DataSet.of(logs, name=plan.name, description=plan.description)


def validate(
    data: Data,
    method: Method = DEFAULT_METHOD,
    *,
    split: str = Split.MASS,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Validated:
    """Predict logs that an estimator has not seen, and compare with those it has.

    Parameters
    ----------
    data, method, options
        As `identify` takes them.
    split
        What is left out together: ``mass`` or ``frequency``.

    Raises
    ------
    InputError
        If the logs cannot be used, or an option is not the method's.
    IdentifiabilityError
        If nothing can be left out, or a part cannot determine the parameters.
    """
    logs, estimator = read(data), make_estimator(method, options)
    quick = estimator.unchecked()
    held = hold_out(logs, quick, _kind(Split, "split", split))
    return Validated.of(logs, estimator.label, held, quick(logs))


def design(
    data: Data | Identified,
    method: Method = DEFAULT_METHOD,
    *,
    swing: float = LARGEST_SWING,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Designed:
    """Rank candidate next experiments by how much they would tell.

    Parameters
    ----------
    data, method, options
        As `identify` takes them, or its result.
    swing
        Largest swing allowed, in rad.

    Raises
    ------
    InputError
        If the logs cannot be used, or an option is not the method's.
    IdentifiabilityError
        If they cannot determine the parameters, or give no covariance.
    """
    logs, found = _estimated(data, method, options)
    return Designed.of(logs, found, next_experiments(logs, found, largest_swing=swing))


def compare(
    data: Data | Identified,
    method: Method = DEFAULT_METHOD,
    *,
    logs: Sequence[int] | None = None,
    mass: float = MASS,
    **options: Any,  # noqa: ANN401 - the fields of the estimator
) -> Compared:
    """Simulate logs in MuJoCo and by the grey-box model, with the parameters identified from them.

    Parameters
    ----------
    data, method, options
        As `identify` takes them, or its result.
    logs
        Numbers of the logs; all if not given.
    mass
        Of the hand in kg, for MuJoCo; the motion does not tell it.

    Raises
    ------
    InputError
        If the logs cannot be used, an option is not the method's, or no hand moves so.
    IdentifiabilityError
        If they cannot determine the parameters.
    """
    whole, found = _estimated(data, method, options, check=False)
    numbers = range(len(whole.logs)) if logs is None else logs
    for number in numbers:
        if not 0 <= number < len(whole.logs):
            raise InputError("compare", "logs", number, f"numbers below {len(whole.logs)}")
    return Compared.of(whole, compare_three(whole, found, numbers, mass=mass))


def _estimated(
    data: Data | Identified, method: Method, options: Mapping[str, Any], *, check: bool = True
) -> tuple[DataSet, Any]:
    """Return logs and an estimate from them, which an identification has already."""
    if isinstance(data, Identified):
        return data.data, data.estimate
    logs, estimator = read(data), make_estimator(method, options)
    return logs, (estimator if check else estimator.unchecked())(logs)


def _parameters(name: str, given: LumpedParameters | Mapping[str, float]) -> LumpedParameters:
    if isinstance(given, LumpedParameters):
        return given
    try:
        return LumpedParameters(**{"p4": float("nan")} | dict(given))
    except TypeError:
        expected = "p1, p2, p3 and, if wanted, p4 and other parameters"
        raise InputError(name, "against", ", ".join(given), expected) from None


def _kind(kind: Any, field: str, value: str) -> Any:  # noqa: ANN401 - any enumeration of texts
    try:
        return kind(value)
    except ValueError:
        raise InputError("butterfly", field, value, " or ".join(map(str, kind))) from None
