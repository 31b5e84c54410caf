"""What is made ahead on other threads comes in order, not all at once, and is given up with who wanted it."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from solver.threads import mapped_ahead


def test_results_come_in_order_and_only_some_items_are_taken_ahead():
    taken = []

    def items():
        for item in range(20):
            taken.append(item)
            yield item

    with ThreadPoolExecutor(2) as pool:
        results = mapped_ahead(pool, lambda item: item * item, items(), ahead=3)
        assert next(results) == 0 and len(taken) == 4
        assert list(results) == [item * item for item in range(1, 20)]


def test_what_waits_is_given_up_with_who_wanted_it_and_errors_arrive():
    held, begun = threading.Event(), []

    def work(item):
        begun.append(item)
        if item == 1:
            raise ValueError("no such item")
        if item > 1:
            held.wait(10)
        return item

    with ThreadPoolExecutor(1) as pool:
        results = mapped_ahead(pool, work, range(50), ahead=8)
        assert next(results) == 0
        with pytest.raises(ValueError, match="no such item"):
            next(results)
        held.set()
    assert len(begun) < 10
