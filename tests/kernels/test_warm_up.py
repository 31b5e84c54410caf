"""Compiling before the clock starts: a fit must find nothing left to compile."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = """
import importlib, pkgutil
import numba, solver.kernels
from solver.kernels.warm_up import compile_kernels

def compiled():
    found = set()
    for module in pkgutil.iter_modules(solver.kernels.__path__):
        if module.name.endswith("_numba"):
            for name, value in vars(importlib.import_module(f"solver.kernels.{module.name}")).items():
                if isinstance(value, numba.core.dispatcher.Dispatcher):
                    found |= {(name, str(signature)) for signature in value.signatures}
    return found

compile_kernels()
before = compiled()
from tests.fit.test_fit import trained
trained(3)
print("compiled in the fit:", sorted(compiled() - before))
"""


def test_a_fit_finds_all_kernels_compiled():
    result = subprocess.run(
        [sys.executable, "-c", SCRIPT], cwd=ROOT, capture_output=True, text=True, timeout=600
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip().endswith("compiled in the fit: []")
