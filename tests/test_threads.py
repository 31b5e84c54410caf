"""What is made ahead on other threads comes in order, not all at once, and is given up with who wanted it;
numpy has none of its own."""

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from solver.threads import mapped_ahead, usable_cores

ROOT = Path(__file__).resolve().parents[1]
AFTER_A_PRODUCT = """
import os
from solver.threads import prepare_runtimes
prepare_runtimes()
import numpy
numpy.ones((500, 500)) @ numpy.ones((500, 500))
print(len(os.listdir("/proc/self/task")))
"""


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


@pytest.mark.skipif(
    not Path("/proc/self/task").is_dir() or usable_cores() < 2,
    reason="threads are counted in /proc",
)
@pytest.mark.parametrize(("asked", "expected"), [(None, 1), ("2", 2)])
def test_numpys_products_stay_on_one_core_unless_the_person_said_more(asked, expected):
    """A fixed waste: two threads took three times as long for the products of a box's axes."""
    environment = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    if asked:
        environment["OPENBLAS_NUM_THREADS"] = asked
    done = subprocess.run(
        [sys.executable, "-c", AFTER_A_PRODUCT], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert int(done.stdout) == expected, done.stderr
