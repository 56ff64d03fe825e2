"""Simulators beside the logs: how far they are from these and from each other."""

import re


def test_the_simulators_agree_and_their_errors_and_residuals_have_tables(results):
    compared = results["comparison"]
    assert compared.to_dataframe()["simulators apart in rad"].max() < 3e-3
    titles = [part.title for part in compared.page().parts]
    assert titles == [
        *("At a glance", "Measured against simulated", "In numbers", "Amplitude and phase"),
        "Residuals",
    ]
    plain, errors, left = compared.tables()
    assert len(plain.headers) == 4
    assert errors.detail
    assert all(re.fullmatch(r"[+-]\d\S*", cell) for cell in errors.rows[0][1:])
    assert errors.rows[0][1:] != ["+0.00"] * 4
    assert left.headers == results["residual"].tables()[0].headers
