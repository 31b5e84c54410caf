"""The hash in Warp, for CUDA; `hashing.uniform_torch` is the plain twin."""

import warp as wp

from .vectors_warp import Integers, Vectors
from .warp_device import launched

wp.set_module_options({"enable_backward": False})


FIRST = wp.constant(wp.uint32(0x7FEB352D))
SECOND = wp.constant(wp.uint32(0x846CA68B))


@wp.func
def mix(x: wp.uint32):
    first = (x ^ (x >> wp.uint32(16))) * FIRST
    second = (first ^ (first >> wp.uint32(15))) * SECOND
    return second ^ (second >> wp.uint32(16))


@wp.func
def unit_number(key: wp.int64, seed: wp.uint32):
    state = mix(seed)
    state = mix(state ^ wp.uint32(key >> wp.int64(32)))
    state = mix(state ^ wp.uint32(key))
    return float(state >> wp.uint32(8)) * (1.0 / 16777216.0)


@wp.kernel
def _uniform(keys: Integers, seed: Integers, out: Vectors):
    n, column = wp.tid()
    out[n, column] = unit_number(keys[n], wp.uint32(seed[0]) + wp.uint32(column))


uniform = launched(_uniform, "out", 2)
