"""The house stays as small as it was made."""

from tests.house import TABLE, table, tuned_numbers

MOST_TUNED_NUMBERS = 204


def test_tuned_numbers_of_identification_are_listed_with_their_meaning_and_no_more_are_added():
    numbers = tuned_numbers()
    assert len(numbers) <= MOST_TUNED_NUMBERS
    assert [each for each in numbers if not each.meaning] == []
    assert TABLE.read_text(encoding="utf-8") == table(numbers), "run python -m tests.house"
