"""The hot loops: for each, a fused numba kernel for CPUs beside its plain torch twin.

The twins are the oracles of the tests and the path taken on every other device. `backend.fast` decides.
"""
