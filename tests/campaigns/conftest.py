"""What the tests of campaigns share."""

import pytest

from tests.campaigns.folders import record


@pytest.fixture
def begun(tmp_path):
    """A campaign of two runs."""
    record(tmp_path / "a", 2)
    return tmp_path / "a"
