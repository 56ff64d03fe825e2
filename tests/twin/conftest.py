"""What all tests of exported joints share."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def _brief():
    """A joint without logs is measured for five seconds, not for a minute."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("butterfly.twin.twin._MINUTE", 5.0)
        yield
