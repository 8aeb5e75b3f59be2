"""Ipopt is not called without room for its BLAS, which waits without end for memory that it cannot have."""

from __future__ import annotations

import mmap
from functools import cache
from typing import Any

import casadi as ca

ROOM = 256 * 2**20
"""Address space that a process needs before its first call of Ipopt [bytes]: the plugin, and buffers of its BLAS.

Measured with `ulimit -v`: with 40 to 128 MB more than after loading CasADi a first solve never returns, with 192 MB
it ends with an error, with 256 MB it solves.
"""


def ipopt(name: str, problem: Any, options: dict[str, Any]) -> ca.Function:
    """Return Ipopt for a problem; MemoryError if it would not get the memory that it begins with."""
    _require_room()
    return ca.nlpsol(name, "ipopt", problem, options)


@cache  # once it was called it has its buffers
def _require_room() -> None:
    try:
        mmap.mmap(-1, ROOM).close()  # no page of it is touched
    except OSError as error:
        raise MemoryError(f"Ipopt needs {ROOM // 2**20} MB of address space") from error
