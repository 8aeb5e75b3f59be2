"""A disk that fails, or a process that dies, at the n-th write: SQLite's and this program's own.

SQLite lets its system calls be replaced (`xSetSystemCall` of its VFS); Python's are replaced in `os`.
Use it in a child process: nothing is put back.
"""

import ctypes
import errno
import os
import re
from pathlib import Path

WRITES = ("write", "mkdir", "rename", "unlink", "fsync", "ftruncate")
"""Of the module `os`."""
CALLS = ("write", "pwrite", "pwrite64", "ftruncate", "unlink")
"""Of SQLite; its fsync is out of reach."""
_LEADING = 3 * [ctypes.c_int] + 3 * [ctypes.c_void_p] + 12 * [ctypes.c_void_p] + [ctypes.c_void_p]


class _Vfs(ctypes.Structure):
    """`sqlite3_vfs` of <sqlite3.h>, version 3."""

    _fields_ = (
        *((f"field{i}", kind) for i, kind in enumerate(_LEADING)),
        ("set_call", ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)),
        ("get_call", ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)),
    )


class Disk:
    """Counts writes, and does something from the n-th on."""

    def __init__(self, at, act, *, once=False):
        """Take the number of the first write to be acted on (0: none); `act` returns an errno, or never."""
        self.at, self.act, self.once, self.count = at, act, once, 0
        self._kept = []
        for name in WRITES:
            setattr(os, name, self._wrapped(getattr(os, name)))
        self._replace_sqlite_s()

    def fault(self):
        """Return the errno of a write that fails, or 0."""
        self.count += 1
        due = self.at and (self.count == self.at or (self.count > self.at and not self.once))
        return self.act() if due else 0

    def _wrapped(self, call):
        def wrapped(*args, **options):
            if code := self.fault():
                raise OSError(code, os.strerror(code))
            return call(*args, **options)

        return wrapped

    def _replace_sqlite_s(self):
        mapped = Path("/proc/self/maps").read_text()
        found = re.search(r"(/\S*libsqlite3\.so\S*)", mapped) or re.search(r"(/\S*_sqlite3\.\S*\.so)", mapped)
        library = ctypes.CDLL(found[1])
        library.sqlite3_vfs_find.restype = ctypes.POINTER(_Vfs)
        vfs = library.sqlite3_vfs_find(None)
        at = ctypes.cast(vfs, ctypes.c_void_p)
        kind = ctypes.CFUNCTYPE(ctypes.c_ssize_t, *[ctypes.c_ssize_t] * 4, use_errno=True)
        replaced = 0
        for name in CALLS:
            original = vfs.contents.get_call(at, name.encode())
            if not original:
                continue
            call = ctypes.CFUNCTYPE(ctypes.c_ssize_t, *[ctypes.c_ssize_t] * 4, use_errno=True)(original)

            def faulty(a, b, c, d, call=call):
                if code := self.fault():
                    ctypes.set_errno(code)
                    return -1
                return call(a, b, c, d)

            self._kept += [call, function := kind(faulty)]
            vfs.contents.set_call(at, name.encode(), ctypes.cast(function, ctypes.c_void_p))
            replaced += 1
        assert replaced >= 3


def full():
    return errno.ENOSPC


def broken():
    return errno.EIO


def dies():
    os._exit(9)
