"""Neural microfacet fields: photos of a shiny object to mesh, PBR textures and HDRI."""

import os

# torch and numba bring an OpenMP runtime each. Idle threads that spin take the cores from the other
# runtime, and from Blender: on two busy cores a step takes ten times as long. Read when they load.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("GOMP_SPINCOUNT", "0")

__version__ = "0.1.0"
