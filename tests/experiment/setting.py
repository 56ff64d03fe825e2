"""A small sweep of six runs, as several tests run it."""

import yaml

from butterfly.experiment.source import Source
from butterfly.experiment.sweep import plan_sweep
from butterfly.experiment.sweep_tables import TABLES
from butterfly.files import shipped

HAND = {"mass": 0.1, "com_distance": 0.05, "inertia": 0.003}
PLANT = {"hand": HAND, "drive": {"torque": {"gain": 10.0}}, "clock": {"step": 0.004}}
PLANT |= {"friction": {"viscous": 1e-3, "coulomb": 1e-4}, "simulator": "grey-box"}
PLANT |= {"encoder": {"steps": 8192, "noise": 2e-4}}
SINGLE = {
    "name": "small",
    "seed": 3,
    "plant": PLANT,
    "added_masses": [{"mass": 0.0, "arm": 0.1}, {"mass": 0.05, "arm": 0.1}],
    "signals": [{"multisine": {"base": 0.5, "harmonics": [4, 6, 8, 11], "peak": 1e-3, "seed": 0}}],
    "duration": 12.0,
    "estimators": [{"method": "weak-form", "terms": []}],
}
SWEEP = SINGLE | {"sweep": {"grid": {"plant.encoder.noise": [0.0, 1e-4]}, "repetitions": 3}}
QUICKSTART = {"extends": "quickstart", "name": "s", "seed": 1}
SHIPPED = yaml.safe_load(shipped("experiments/quickstart.yaml").read_text())
THREE_MASSES = [*SINGLE["added_masses"], {"mass": 0.1, "arm": 0.1}]
ESTIMATORS = [{"method": "weak-form", "terms": terms} for terms in ([], ["load"])]


def written(path, **content):
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def changed(path, **content):
    """Write an experiment file anew with some of its keys changed."""
    return written(path, **yaml.safe_load(path.read_text()) | content)


def planned(path):
    return plan_sweep(Source(path))


def small_plan(folder, **changes):
    return planned(written(folder / "small.yaml", **SWEEP | changes))


class HereEngine:
    """Does tasks in this process, one by one: for what cannot depend on where they are done."""

    def run(self, work, tasks, tables):
        return (work(task, tables) for task in tasks)


def tables_of(folder):
    return {name: (folder / f"{name}.parquet").read_bytes() for name in TABLES}
