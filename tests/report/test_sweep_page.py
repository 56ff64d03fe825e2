"""The report of a sweep."""

import numpy as np
import pytest

from butterfly.experiment.record import EstimateRecord, Outcome, RunRecord, SweepRecord, SweepRun
from butterfly.experiment.store import ResultStore
from butterfly.experiment.sweep_tables import ESTIMATES, RUNS, Estimates
from butterfly.report.parameter_table import parameter_table
from butterfly.report.sweep_page import closest, sweep_page, worst_table
from tests.report.setting import estimate_with, parameter_row


@pytest.mark.parametrize(
    ("shift", "named"), [(0.0, ["a", "b"]), (0.3, ["a", "b"]), (3.0, ["a"]), (-3.0, ["b"])]
)
def test_a_sweep_names_no_winner_within_noise(shift, named):
    runs = 40
    noise = np.random.default_rng(0).uniform(1, 2, (2, runs))
    deviations = np.concatenate([noise[0] + 5, noise[1] + 5 + shift * 0.1])
    table = Estimates(
        {
            "number": np.tile(np.arange(runs, dtype=float), 2),
            "estimator": np.repeat(np.array(["a", "b"], dtype=object), runs),
            "deviation": deviations * np.tile([1.0, -1.0], runs),
        }
    )
    assert sorted(closest(table)) == named


def test_the_worst_runs_have_the_cells_of_the_table_of_parameters():
    names, true = ["p1", "p2", "p1", "p2"], np.array([1.0, 1.0, 1.0, 1e-3])
    value = np.array([1.01, 0.4, 1.02, 0.05])
    texts = {"estimator": ["m"] * 4, "parameter": names, "key": ["ab1"] * 2 + ["cd2"] * 2}
    columns = {name: np.array(texts[name], dtype=object) for name in texts}
    columns |= {"number": np.array([0.0, 0.0, 1.0, 1.0]), "value": value, "true": true}
    columns |= {"lower": value - 0.1, "upper": value + 0.1, "deviation": value / true - 1}
    columns |= {"fit_median": np.full(4, 99.0), "plant.hand.mass": np.array([0.1, 0.1, 0.2, 0.2])}
    table = Estimates(columns)
    worst = worst_table(table, ["plant.hand.mass"], 5)
    assert worst.headers[:4] == ["run", "estimator", "parameter", "deviation"]
    assert [[*map(str, row)] for row in worst.rows] == [
        ["1", "m", "p2", "+0.049 N m s/rad", "99.0", "0.2"],  # its truth is next to 0
        ["0", "m", "p2", "-60.00 %", "99.0", "0.1"],
    ]
    one = parameter_row(name="p2", value=0.4, true=1.0, lower=0.3, upper=0.5)
    assert parameter_table("", [one], "deviation").rows == [["-60.00 %"]]


def test_a_number_of_a_sweep_is_that_of_the_row_of_its_estimate_s_table(tmp_path):
    """From an estimate to a cell: the row of its parameter, the sweep's table, the page's row."""
    estimate = estimate_with(reach=0.05)
    truth = dict(zip(estimate.names, 1.001 * estimate.values, strict=True))
    record = EstimateRecord(estimator="m", estimate=estimate, truth=truth)
    place = {"key": "0" * 24, "repetition": 0, "seed": 0, "overrides": {}}
    store = ResultStore(tmp_path)
    store.write(Outcome(record=RunRecord(**place, status="ok", estimates=(record,))))
    about = {"name": "one", "description": "", "seed": 0, "versions": {}, "worst": 1}
    runs = (SweepRun(number=0, **place),)
    store.end_sweep(SweepRecord(**about, fields=(), runs=runs))
    page = sweep_page(store.sweep(), store.table(RUNS), store.table(ESTIMATES))
    (table,) = [part.tables[0] for part in page.sections if part.title.startswith("Recovery")]
    for row, cells in zip(record.parameters, table.rows, strict=True):
        assert [*cells][:4] == ["m", row.name, "1", f"{100 * row.deviation:.3g}"]
    stored = store.table(ESTIMATES).to_pylist()
    assert [entry["deviation"] for entry in stored] == [row.deviation for row in record.parameters]
    assert [entry["findings"] for entry in stored] == [", ".join(record.findings)] * 4
