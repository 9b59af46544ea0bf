"""Memory that a process has freed is kept for what it allocates next."""

from __future__ import annotations

import ctypes
import sys

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_BYTES = 256 * 2**20


def keep_freed_memory() -> None:
    """Tell the C library to keep up to 256 MB of freed memory instead of returning it at once.

    Tensors of a megabyte live for a moment each. By default glibc maps new pages for most of them, and the
    system clears every page first, which costs several times what is computed on them. Other C libraries
    are left as they are.
    """
    if not sys.platform.startswith("linux"):
        return
    library = ctypes.CDLL(None)
    if hasattr(library, "gnu_get_libc_version"):
        library.mallopt(_TRIM_THRESHOLD, _BYTES)
        library.mallopt(_MMAP_THRESHOLD, _BYTES)
