"""Which share of a fit's step each CPU kernel takes, on one thread."""

from __future__ import annotations

import importlib
import pkgutil
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numba.core.registry
import numpy as np

import solver.kernels
from solver.capture.photos import load_photos
from solver.capture.read import read_capture
from solver.fit.presets import settings_for
from solver.fit.start import new_trainer
from solver.kernels import adam, backend

WARM_UP, STEPS = 30, 60


def shares_of_a_step(capture_folder: Path, preset: str) -> tuple[float, Counter]:
    """Seconds of a step on the finest grid, and of them those of each kernel by `module.function`."""
    capture = read_capture(capture_folder)
    with _timed() as seconds:
        trainer = new_trainer(
            capture,
            load_photos(capture),
            settings_for(preset, {}),
            0,
            None,
            "cpu",
            lambda done: None,
        )
        finest = np.nextafter(1.0, 0.0)
        for _ in range(WARM_UP):
            trainer.advance(finest)
        seconds.clear()
        started = time.perf_counter()
        for _ in range(STEPS):
            trainer.advance(finest)
        step = (time.perf_counter() - started) / STEPS
    return step, Counter({name: value / STEPS for name, value in seconds.items()})


@contextmanager
def _timed() -> Iterator[Counter]:
    """Seconds of every parallel kernel, which nothing but Python calls, while this block runs."""
    seconds: Counter = Counter()
    names = [m.name for m in pkgutil.iter_modules(solver.kernels.__path__) if m.name.endswith("numba")]
    modules = [importlib.import_module(f"solver.kernels.{name}") for name in names] + [adam]
    found = [
        (module, name, kernel)
        for module in modules
        for name, kernel in vars(module).items()
        if isinstance(kernel, numba.core.registry.CPUDispatcher) and kernel.targetoptions.get("parallel")
    ]
    for module, name, kernel in found:
        family = module.__name__.rsplit(".", 1)[-1].removesuffix("_numba")
        setattr(module, name, _timing(kernel, f"{family}.{name.strip('_')}", seconds))
    backend._family_on.cache_clear()  # holds the kernels that it has found
    try:
        yield seconds
    finally:
        for module, name, kernel in found:
            setattr(module, name, kernel)
        backend._family_on.cache_clear()


def _timing(kernel: Callable, name: str, seconds: Counter) -> Callable:
    def run(*arguments):
        started = time.perf_counter()
        kernel(*arguments)
        seconds[name] += time.perf_counter() - started

    return run
