"""For all tests: the same examples every time, no network, threads that wait as the solver's do."""

import os
import socket
import sys
from collections import Counter

import pytest
from hypothesis import settings

from solver.threads import prepare_runtimes

prepare_runtimes()
SIDE_BY_SIDE = "PYTEST_XDIST_WORKER" in os.environ
if SIDE_BY_SIDE:
    os.environ.setdefault("OMP_NUM_THREADS", "1")

settings.register_profile("project", deadline=None, derandomize=True)
settings.load_profile("project")

_connect = socket.socket.connect


def _connect_here(self, address):
    if self.family != getattr(socket, "AF_UNIX", None) and address[0] not in (
        "127.0.0.1",
        "::1",
        "localhost",
    ):
        raise OSError(f"A test tried to reach {address}; tests do not use the network.")
    return _connect(self, address)


def pytest_collection_modifyitems(items):
    """Files of few tests come first, for most of these are of whole jobs: one of them begun last would leave
    the other processes with nothing to do."""
    tests = Counter(item.path for item in items)
    items.sort(key=lambda item: tests[item.path])


@pytest.fixture(autouse=True)
def no_network(monkeypatch):
    monkeypatch.setattr(socket.socket, "connect", _connect_here)


@pytest.fixture(scope="session", autouse=True)
def a_core_each():
    """Of processes side by side. With a thread for each core of all, the same tests take 1.7 times as long
    on two cores."""
    if SIDE_BY_SIDE and "numba" in sys.modules:  # which Blender's tests do without
        sys.modules["numba"].set_num_threads(1)


@pytest.fixture(scope="session")
def duck(tmp_path_factory):
    """The sample, made small; not to be written to."""
    from tests.small_duck import write_small_duck

    return write_small_duck(tmp_path_factory.mktemp("small") / "duck")
