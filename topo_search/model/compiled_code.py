"""Compiled functions that numba keeps on disk: dropped when any source that they were made from has changed.

numba keeps a compiled function with the date of its own file, not of the files that it calls into or takes
constants from: after a change in one of them what is kept would be used on. So it is marked with a digest of all.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any


def refresh(dispatcher: Any, room: Path, *others: Path) -> bool:
    """Drop what is kept of the functions of a folder, unless it was made from the sources as they are.

    Call this before the first of them is called. Processes that do so at once drop each other's new files at worst,
    and compile once more.

    Args:
        dispatcher: one of the functions, which knows where numba keeps them.
        room: the folder of their sources.
        others: more files or folders that they call into or take constants from.

    Returns:
        Whether what is kept was up to date.
    """
    own = sorted(room.glob("*.py"))
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in (*own, *_files(others)))).hexdigest()
    folder = Path(str(dispatcher.stats.cache_path))
    mark = folder / f"{room.name}.sha256"
    if mark.exists() and mark.read_text() == digest:
        return True
    for source in own:
        for kept in folder.glob(f"{source.stem}.*.nb[ci]"):
            kept.unlink(missing_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    written = folder / f"{room.name}.{os.getpid()}.partial"
    written.write_text(digest)
    written.replace(mark)
    return False


def _files(places: tuple[Path, ...]) -> Iterator[Path]:
    """Yield the sources of files and folders."""
    for place in places:
        yield from sorted(place.glob("*.py")) if place.is_dir() else (place,)
