"""Residuals of chosen logs, in a table that says what its columns are."""

import pytest


@pytest.mark.parametrize("kind", ["comparison", "residual"])
def test_residuals_have_a_caption_and_findings_of_their_own(results, kind):
    assert results[kind].page().parts[-1].tables[-1].caption.startswith("Error: rms of")
    found = results[kind].to_dict()
    assert len(found["residuals"]["logs"]) == 4
    assert found["residuals"]["findings"] != found["findings"] != []


def test_the_tiles_are_of_the_log_with_the_largest_error(results):
    found = results["residual"]
    worst = max(found.rows(), key=lambda row: row["error in % of the motion"])
    error, *_ = found.facts()
    assert float(error.value.split()[0]) == pytest.approx(worst["error in % of the motion"], 1e-3)
