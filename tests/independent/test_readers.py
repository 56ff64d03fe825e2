"""What a whole file of any dialect says is what is read: a second reader has the same arrays."""

import pytest

pytest.importorskip("pandas")
pytest.importorskip("h5py")

from tests.independent.readers import WRITERS, difference


@pytest.mark.parametrize("kind", WRITERS)
def test_random_whole_files_are_read_as_a_second_reader_reads_them(kind, tmp_path):
    assert [found for seed in range(60) if (found := difference(kind, seed, tmp_path))] == []
