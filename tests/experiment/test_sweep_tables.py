"""Tables of a sweep."""

import numpy as np
import pyarrow as pa
import pytest

from butterfly.experiment.record import OK, SweepRun
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep_tables import ESTIMATES, RUNS, Estimates, SweepColumns


def test_estimates_without_intervals_have_no_coverage():
    bounds = {"lower": [0.0, 2.0, np.nan], "upper": [2.0, 3.0, np.nan], "true": [1.0, 1.0, 1.0]}
    columns = {name: np.array(values) for name, values in bounds.items()}
    assert Estimates(columns).coverage == 0.5
    assert np.isnan(Estimates({name: values[2:] for name, values in columns.items()}).coverage)


MIXED = [1.0, "a", True, None, {"x": 1}, {"x": {"y": 2}}, [1, 2], 10**400, 2**60, float("nan")]

TYPED = [(values, pa.string()) for values in (MIXED, [10**400, 1], [True, 1], [1e-4, "1e-4"])]
TYPED += [([2**60, 1.5, None], pa.float64()), ([None], pa.float64()), ([True, False], pa.bool_())]


@pytest.mark.parametrize(("values", "kind"), TYPED)
def test_a_field_may_be_set_to_anything(values, kind):
    runs = [
        SweepRun(number=k, key=str(k), repetition=0, seed=2**63 - 1, overrides={"f": value})
        for k, value in enumerate(values)
    ]
    columns = SweepColumns(("f",), runs)
    assert columns.schema(RUNS).field("f").type == kind
    for name in (RUNS, ESTIMATES):
        rows = [row for run in runs for row in columns.rows(name, run, None)]
        table = pa.Table.from_pylist(rows, schema=columns.schema(name))
        assert table.num_rows == (len(values) if name == RUNS else 0)
    assert (table["f"].null_count == 0) or None in values


@pytest.mark.usefixtures("undisturbed")
def test_the_tables_say_what_was_set_and_found(folder):
    store = ResultStore(folder / "one")
    runs, estimates = store.table(RUNS), store.table(ESTIMATES)
    assert runs["plant.encoder.noise"].to_pylist() == [0.0] * 3 + [1e-4] * 3
    assert runs["status"].to_pylist() == [OK] * 6
    assert estimates.num_rows == 6 * 6
    for row in estimates.to_pylist():
        assert row["estimator"] == "weak-form"
        if row["parameter"] in {"p1", "p3", "p4"}:
            assert abs(row["deviation"]) < 0.02
    record = store.read(runs["key"][0].as_py())
    assert record.versions["butterfly"]
    assert record.seconds["total"] >= record.seconds["simulate"]
