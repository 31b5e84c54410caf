"""Where Warp keeps kernels on Windows, whose compilers cannot open every path."""

import os
import sys
from pathlib import Path

FIRST_AID = (
    "on Windows NVIDIA's compiler opens no path with letters beyond a to z, such as ä or й: choose a "
    "Folder such as C:\\nmf in the preferences and press Set Up Solver again"
)
"""https://github.com/hashcat/hashcat/issues/4885, https://github.com/cupy/cupy/issues/7581"""


def kernel_cache() -> Path | None:
    """Beside the environment, where a person's own folder bears a name that Warp's compilers cannot open
    and the environment's does not; None: Warp's own choice."""
    own = os.environ.get("LOCALAPPDATA", "")
    if os.name != "nt" or own.isascii() or "WARP_CACHE_PATH" in os.environ or not sys.prefix.isascii():
        return None
    return Path(sys.prefix).parent / "warp"


def first_aid() -> str:
    """What to do if Warp cannot compile, as far as it is its place; empty if that is not why."""
    return FIRST_AID if os.name == "nt" and not sys.prefix.isascii() else ""
