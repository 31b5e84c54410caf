"""Bytes that arrive on a pipe, without a read that waits for them on Windows."""

import os
import time
from collections.abc import Callable

if os.name == "nt":  # not at the first look: loading them takes longer than a list that ends at once
    import ctypes
    import msvcrt
    from ctypes import wintypes

INTERVAL = 0.1
"""seconds between looks at the pipe"""


def next_bytes(descriptor: int, waiting: Callable[[int], int | None] | None = None) -> bytes:
    """What came next on a pipe, as soon as something has; empty once it has ended.

    On Windows a thread that waits in a read holds the pipe's lock, and the start of any library that
    asks what standard input is (NumPy's, SciPy's) then waits for the same; so there we look whether
    something is there before we read it.

    Args:
        waiting: how many bytes a pipe holds, or None if it has ended; None: Windows' own answer there,
            and a read that waits elsewhere.
    """
    if waiting is None and os.name == "nt":
        waiting = _waiting_on_windows
    while waiting is not None:
        count = waiting(descriptor)
        if count is None:
            return b""
        if count:
            break
        time.sleep(INTERVAL)
    # On the descriptor: a buffered reader would hold a lock at the interpreter's end.
    return os.read(descriptor, 4096)


def _waiting_on_windows(descriptor: int) -> int | None:
    peek = ctypes.windll.kernel32.PeekNamedPipe
    peek.argtypes = [
        wintypes.HANDLE, wintypes.LPVOID, wintypes.DWORD, wintypes.LPDWORD, wintypes.LPDWORD,
        wintypes.LPDWORD,
    ]  # fmt: skip
    count = wintypes.DWORD()
    there = peek(msvcrt.get_osfhandle(descriptor), None, 0, None, ctypes.byref(count), None)
    return count.value if there else None
