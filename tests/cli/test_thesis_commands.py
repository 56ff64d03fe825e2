"""`butterfly reproduce`."""

import pytest


@pytest.mark.slow
def test_the_thesis_is_reproduced(butterfly, logs_folder, tmp_path):
    code, out, _ = butterfly("reproduce", "thesis", "--root", logs_folder, "--out", tmp_path)
    assert code == 0
    assert "3.7740" in out
    assert (tmp_path / "figure_12.csv").exists()
    code, _, err = butterfly("reproduce", "everything")
    assert code == 2
    assert "thesis" in err
