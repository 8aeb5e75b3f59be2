"""Room for linear algebra, which waits without end for memory that it cannot have."""

from __future__ import annotations

import mmap

ROOM = 256 * 2**20
"""Address space that a process needs before its first call of Ipopt [bytes]: the plugin, and buffers of its BLAS.

Measured with `ulimit -v`: with 40 to 128 MB more than after loading CasADi a first solve never returns, with 192 MB
it ends with an error, with 256 MB it solves.
"""


def require_room() -> None:
    """Raise MemoryError if Ipopt would not get the memory that it begins with."""
    try:
        mmap.mmap(-1, ROOM).close()  # no page of it is touched
    except OSError as error:
        raise MemoryError(f"Ipopt needs {ROOM // 2**20} MB of address space") from error
