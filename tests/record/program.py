"""All that the record asks of the program, in thin functions.

What a record holds is named here, and by nothing in the program: where the program's inside is
renamed, these functions are adjusted, and records of before and after compare.
"""

import json
import subprocess
import sys
from functools import cache, lru_cache
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np

import butterfly as bf
from tests.independent import kinds, robots
from tests.independent.scores import METHODS

CHECKOUT = Path(__file__).parents[2]
Refusal = bf.ButterflyError
FAMILIES = {
    family: [name for name in METHODS if family in METHODS[name][1]] for family in robots.FAMILIES
}
KINDS = tuple(kinds.KINDS)
SAMPLES = 7  # of a free run
TABLES = ("rows", "left_out", "fit", "held_out", "residuals", "logs")  # of to_dict
DERIVED = {"resonance", "damping_ratio", "decay_time", "speed_gain"}  # not told by 6a36961
ORBIT = (
    *("target_rad", "amplitudes_rad", "free_run_rms_rad", "cross_orbit"),
    *("parameters", "covariance", "left_out", "condition"),
)


@cache
def real_logs(folder, count=None):
    """Read the thesis's logs, or some from all over the list."""
    data = bf.read("real-logs", root=folder)
    if count is None:
        return data
    rows = np.linspace(0, len(data.recorded) - 1, count).astype(int)
    return bf.read([data.recorded[k] for k in rows], repair=["duplicate"], name="some")


def read(folder, **told):
    """Read a manifest, or a folder with one."""
    return bf.read(folder, **told)


def simulate(experiment, folder):
    """Simulate an experiment, and write its logs."""
    return bf.simulate(experiment, out=folder)


def identify(data, method="auto", **options):
    """Identify; the result is what the others take."""
    return bf.identify(data, method, **options)


@lru_cache(maxsize=1)
def robot(family, number, seed):
    """Return the logs of a robot of a family."""
    return robots.draw(family, number, seed).data


def identify_robot(data, method):
    """Identify it as the benchmark of that name does."""
    return bf.identify(data, METHODS[method][0])


def write_kind(kind, number, seed, folder):
    """Write the logs of a robot of a kind, and its owner's manifest."""
    kinds.draw(kind, number, seed).write(folder)


def identification(found, data):
    """Return the facts of an identification."""
    estimate, told = found.estimate, found.to_dict()
    seen = {key: each for key, each in told["residuals"].items() if key != "findings"}
    residuals, seen = flat(seen)
    parts = {name: each for name, each in told["physical"].items() if name not in DERIVED}
    facts = _facts(
        numbers=estimated(estimate)
        | {
            "fit": found.fits,
            "held_out": found.held_out,
            "known": flat(told["data"]["known"])[0],
            "physical": flat(parts)[0],
            "residuals": residuals,
            "prediction": free_runs(data, found),
        },
        texts=judged(estimate)
        | {"verdict": str(found.standing)}
        | {f"residuals/{place}": text for place, text in seen.items()},
        words=[*found.verdict, *found.summary],
    )
    facts["numbers"]["finding"] = {
        f"{k} {each.kind}": each.number for k, each in enumerate(estimate.findings)
    }
    return facts


def estimated(estimate):
    """Return the numbers of an estimate."""
    names = estimate.names
    by_name = {
        "value": estimate.values,
        "standard_error": estimate.standard_errors,
        "lower": estimate.lower,
        "upper": estimate.upper,
        "freedom": [] if estimate.freedom is None else estimate.freedom,
    }
    pairs = combinations_with_replacement(range(len(names)), 2)
    return {key: dict(zip(names, values, strict=False)) for key, values in by_name.items()} | {
        "covariance": {f"{names[i]} {names[j]}": estimate.covariance[i, j] for i, j in pairs},
        "left_out": _each(names, estimate.left_out.items()),
        "rival": _each(names, enumerate(each.values for each in estimate.rivals)),
        "held": dict(estimate.fixed),
        "local": {f"{k} {name}": x for k, own in estimate.local.items() for name, x in own.items()},
        "resonance": {str(mass): omega for mass, omega in estimate.resonances.items()},
        "condition": {"number": estimate.condition},
        "horizon": {"s": estimate.horizon},
    }


def judged(estimate):
    """Return what an estimate is, but for its numbers."""
    return {
        "method": estimate.method,
        "names": list(estimate.names),
        "ending": str(estimate.ending),
        "on_bound": list(estimate.on_bound),
        "findings": [
            " ".join([str(each.kind), *each.parameters, *each.logs]) for each in estimate.findings
        ],
    }


def free_runs(data, found):
    """Return a few angles of the free runs of the first log and the last, by `predict`."""
    try:
        predicted = bf.predict([data.logs[0], data.logs[-1]], found, bands=False)
    except Refusal:
        return {}
    runs = [each.run.simulated for each in predicted.predictions]
    rows = [np.linspace(0, run.size - 1, SAMPLES).astype(int) for run in runs]
    return {f"{k} {i}": run[i] for k, run in enumerate(runs) for i in rows[k]}


def logs(data):
    """Return facts of logs: a few samples of the first and the last."""
    columns = {
        f"{k} {name} {i}": getattr(data.logs[k], name)[i]
        for k in (0, -1)
        for name in ("time", "input", "angle")
        for i in np.linspace(0, data.logs[k].time.size - 1, SAMPLES).astype(int)
    }
    return _facts(numbers={"prediction": columns}, texts={"logs": [x.name for x in data.logs]})


def orbit(experiment, folder):
    """Hold an orbit and re-calibrate next to it, as the command does."""
    answer = Path(folder) / "orbit.json"
    command = ["run", experiment, "--out", str(folder), "--json", str(answer)]
    python = [sys.executable, "-m", "butterfly"]
    subprocess.run([*python, *command], cwd=CHECKOUT, capture_output=True, check=False)  # noqa: S603
    told = json.loads(answer.read_text(encoding="utf-8"))["orbit"]
    return _facts(
        numbers={key: flat(told[key])[0] for key in ORBIT},
        texts={key: told[key] for key in ("verdict", "ending", "method")}
        | {"findings": [each["kind"] for each in told["findings"]]},
        words=told["summary"],
    )


def answered(verb, *told, **options):
    """Return facts of what validate, design, compare, predict, draws or changed answers."""
    result = getattr(bf, verb)(*told, **options)
    told = result.to_dict()
    flats = {key: flat(told[key]) for key in TABLES if key in told}
    cells = [text for _, texts in flats.values() for text in texts.values()]
    return _facts(
        numbers={key: numbers for key, (numbers, _) in flats.items()},
        texts={"verdict": str(result.standing)},
        words=[*result.summary, *cells],
    )


def refused(error):
    """Return the facts of an error."""
    crash = "" if isinstance(error, Refusal) else "crash: "
    texts = {"refused": crash + type(error).__name__, "field": getattr(error, "field", "")}
    return _facts(texts=texts, words=[str(error)])


def flat(content, at=""):
    """Return numbers and other things of a nested content, by their paths."""
    if isinstance(content, dict | list | tuple):
        pairs = content.items() if isinstance(content, dict) else enumerate(content)
        parts = [flat(each, f"{at}/{key}" if at else str(key)) for key, each in pairs]
        return {k: v for part in parts for k, v in part[0].items()}, {
            k: v for part in parts for k, v in part[1].items()
        }
    if isinstance(content, str | bool):
        return {}, {at: str(content)}
    return {at: content}, {}


def _each(names, parts):
    return {
        f"{key} {name}": value
        for key, values in parts
        for name, value in zip(names, values, strict=True)
    }


def _facts(*, numbers=None, texts=None, words=()):
    return {"numbers": numbers or {}, "texts": texts or {}, "words": list(words)}
