"""How long a step of the fit takes on each path that a device has, in one run.

    python benchmarks/step.py                           the CPU: numba, Warp and plain torch
    python benchmarks/step.py --device cuda --capture scenes/materials --preset standard
    python benchmarks/step.py --short                   plain torch and kernels, a few steps

Steps are those of a fit that has just begun on its finest grid; the paths take them in turn, so that a
machine that gets slower does so for all. On a card they are also replayed, as a fit does it. Torch's
operations are counted too, without those that only look at a tensor in another way: on a card each is a
launch, and launches are what a step that is not replayed waits for.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from solver.threads import prepare_runtimes  # noqa: E402

prepare_runtimes()

import numpy as np  # noqa: E402
import torch  # noqa: E402
from torch.utils._python_dispatch import TorchDispatchMode  # noqa: E402

from benchmarks.machine import describe_machine  # noqa: E402
from solver.capture.photos import load_photos  # noqa: E402
from solver.capture.read import read_capture  # noqa: E402
from solver.fit.presets import settings_for  # noqa: E402
from solver.fit.start import new_trainer  # noqa: E402
from solver.kernels.backend import forced_path  # noqa: E402
from solver.kernels.warm_up import compile_kernels  # noqa: E402

REPLAYED = "warp, replayed"
PATHS = {"cpu": ("torch", "numba", "warp"), "cuda": ("torch", "warp", REPLAYED), "mps": ("torch",)}
WARM_UP, ROUNDS = 2, 3
SHORT = 2
"""steps of the only round of a short run"""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--capture", type=Path, default=ROOT / "samples" / "duck")
    parser.add_argument("--preset", default="draft")
    parser.add_argument("--device", default="cpu", choices=list(PATHS))
    parser.add_argument("--steps", type=int, default=10, help="a round")
    parser.add_argument("--short", action="store_true", help="two paths, a few steps each")
    parser.add_argument("--set", action="append", default=[], metavar="section.field=value")
    options = parser.parse_args()
    settings = settings_for(options.preset, dict(text.split("=", 1) for text in options.set))
    capture = read_capture(options.capture)
    photos = load_photos(capture)
    paths, rounds, steps = PATHS[options.device], ROUNDS, options.steps
    if options.short:
        paths, rounds, steps = paths[:2], 1, SHORT
    trainers, seconds = {}, {path: [] for path in paths}
    for path in paths:
        # Plain torch takes minutes for what a fit begins with, which is no part of a step.
        first = paths[-1] if options.short else path
        with on(first):
            if first != "torch":
                compile_kernels(options.device)
            trainers[path] = new_trainer(
                capture, photos, settings, 0, None, options.device, lambda fraction: None
            )
            if path != REPLAYED:
                trainers[path].replay = None
            take_steps(trainers[path], WARM_UP, options.device)
    for _ in range(rounds):
        for path in paths:
            with on(path):
                took = take_steps(trainers[path], steps, options.device)
                seconds[path].append(took / steps)
    print(f"{describe_machine()}; {options.capture.resolve().name}, {options.preset}, {options.device}.\n")
    print("| path | ms a step | times faster than plain torch | operations of torch's a step |")
    print("| --- | ---: | ---: | ---: |")
    for path in paths:
        best = min(seconds[path])
        # A mode sees nothing of what is replayed.
        trainers[path].replay = None
        with on(path), Operations() as operations:
            take_steps(trainers[path], 1, options.device)
        ratio = min(seconds["torch"]) / best
        print(f"| {path} | {1e3 * best:.1f} | {ratio:.1f} | {operations.count} |")
    if options.device == "cuda":
        print(f"\nPeak {torch.cuda.max_memory_allocated() / 2**30:.1f} GiB of its memory.")


def on(path: str) -> contextlib.AbstractContextManager:
    """Within this block every computation takes the path."""
    return forced_path("warp" if path == REPLAYED else path)


class Operations(TorchDispatchMode):
    """Counts operations that do something with a tensor's numbers."""

    def __init__(self):
        super().__init__()
        self.count = 0

    def __torch_dispatch__(self, operation, types, args=(), kwargs=None):
        schema = operation._schema
        only_looks = bool(schema.returns) and all(r.alias_info is not None for r in schema.returns)
        in_place = any(a.alias_info and a.alias_info.is_write for a in schema.arguments)
        only_makes_room = "empty" in str(operation)
        self.count += (in_place or not only_looks) and not only_makes_room
        return operation(*args, **(kwargs or {}))


def take_steps(trainer, count: int, device: str) -> float:
    """Seconds of steps on the finest grid."""
    finest = np.nextafter(1.0, 0.0)
    started = time.perf_counter()
    for _ in range(count):
        trainer.advance(finest)
    if device == "cuda":
        torch.cuda.synchronize()
    return time.perf_counter() - started


if __name__ == "__main__":
    main()
