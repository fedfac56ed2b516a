"""Work that may be in vain is counted, the same whatever a process did before, and ends where no more is allowed."""

from __future__ import annotations

import pytest

from mor.allowance import LEAST, Allowance, SpentError, allowed, counted_in, of_iteration, spend, within
from mor.approximate.remembered import remembered


def test_work_beyond_what_is_allowed_ends() -> None:
    spend(10)  # nobody counts
    some = Allowance(100)
    with within(some, 50):
        spend(50)
        with pytest.raises(SpentError):
            spend(1)
    with counted_in(some):
        spend(1000)
    assert some.spent == 1050
    assert not some.is_left


def test_an_allowance_within_another_one_is_part_of_it_and_within_itself_counts_once() -> None:
    whole, part = Allowance(100), Allowance(60)
    with within(whole):
        with within(part):
            spend(40)
        with within(whole, 90):
            spend(50)
            with pytest.raises(SpentError):
                spend(1)
    assert (part.spent, whole.spent) == (40, 90)


def test_what_is_spent_does_not_depend_on_what_was_answered_before() -> None:
    calls = []

    @remembered(2)
    def work_out(number: int) -> int:
        calls.append(number)
        spend(30)
        return number + 1

    def asked(most: float) -> int:
        some = Allowance(most)
        with within(some):
            try:
                assert [work_out(k) for k in (1, 1, 2, 1)] == [2, 2, 3, 2]
            except SpentError:
                return -some.spent
        return some.spent

    assert asked(100) == asked(100) == 60
    assert calls == [1, 2]  # the second time all was known, and cost the same
    assert asked(50) == -50
    work_out(3), work_out(4)  # 1 and 2 are forgotten
    assert asked(50) == -50
    assert asked(100) == 60


def test_large_networks_may_take_adjustments_small_ones_what_any_may() -> None:
    assert allowed(100, 3) == LEAST
    assert allowed(10_000_000, 3) == 3 * 10 * of_iteration(10_000_000)
