"""Reading files that anybody may have made: regular ones alone, and of a limited size."""

from __future__ import annotations

import os
import stat
from pathlib import Path

KINDS = {
    stat.S_IFBLK: "a block device",
    stat.S_IFCHR: "a character device",
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
}
"""What is no regular file."""


class NotReadable(ValueError):
    """A file that is not read; says which rule it breaks, and what it is."""


def read_regular(path: str | Path, *, most_bytes: int) -> bytes:
    """Return the content of a regular file.

    Nothing is read before the open file itself is known to be a regular one of at most that size, so that no pipe
    can keep the reader waiting and no device can fill the memory.

    Args:
        path: the file, or a link to it.
        most_bytes: size from which it is refused.

    Raises:
        NotReadable: it is no regular file, is too large, or has a name that no file can have.
        FileNotFoundError: there is none.
        OSError: it cannot be opened or read.
    """
    try:
        _require_regular(os.stat(path), most_bytes)  # so that no device or pipe is even opened
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    except ValueError as error:  # a zero byte, or half of a surrogate pair
        if isinstance(error, NotReadable):
            raise
        raise NotReadable(f"must have a name that a file can have ({error})") from None
    with os.fdopen(handle, "rb") as stream:
        _require_regular(os.fstat(handle), most_bytes)  # what is there now
        content = stream.read(most_bytes + 1)
    if content is None:  # a log of the kernel calls itself regular
        raise NotReadable("must be a regular file, but reading it would wait")
    if len(content) > most_bytes:  # it grows
        raise NotReadable(f"must have at most {most_bytes:,} bytes, but has more")
    return content


def read_text(path: str | Path, *, most_bytes: int) -> str:
    """Return the text of a regular file, without the mark that some programs put first; errors as `read_regular`.

    Raises:
        NotReadable: also if it is not UTF-8; names the first byte that is none, and its offset.
    """
    content = read_regular(path, most_bytes=most_bytes)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        at = error.start + len(content) - len(error.object)  # the codec leaves the mark out
        raise NotReadable(f"must be UTF-8 text, but got the byte {content[at]:#04x} at offset {at}") from None


def _require_regular(status: os.stat_result, most_bytes: int) -> None:
    if not stat.S_ISREG(status.st_mode):
        kind = KINDS.get(stat.S_IFMT(status.st_mode), "of another kind")
        raise NotReadable(f"must be a regular file, but is {kind}")
    if status.st_size > most_bytes:
        raise NotReadable(f"must have at most {most_bytes:,} bytes, but has {status.st_size:,}")
