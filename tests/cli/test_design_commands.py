"""`butterfly design`."""


def test_next_experiments_are_ranked(butterfly, quick_data):
    code, out, err = butterfly("design", quick_data, "--limit", 3)
    assert code == 0, err
    assert "rad/s" in out or "free decay" in out
