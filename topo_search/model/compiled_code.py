"""Compiled functions that numba keeps on disk, and what makes them new.

numba keeps a compiled function with the date of its own file, not of the files that it calls into or takes
constants from: after a change in one of them what is kept would be used on. So it is marked with a digest of all.

numba takes what it reads back on trust: a damaged file would fail every solve, or be machine code that computes
something else. So each file carries a digest, and one that is damaged is compiled anew.

numba refuses to compile where neither NUMBA_CACHE_DIR, the installation nor the user's cache can be written to,
as in a container without a home. A temporary folder serves there.
"""

from __future__ import annotations

import hashlib
import io
import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.types import unliteral

from topo_search.supervisor import tell

Function = TypeVar("Function", bound=Callable[..., Any])

CACHE_DIR = "NUMBA_CACHE_DIR"
"""Environment variable of numba: the folder to keep compiled functions in."""


def njit(
    *, cache: bool, literals: bool = True, allocates: bool = True, **options: Any
) -> Callable[[Function], Function]:
    """Return a decorator like `numba.njit`, whose files are checked when they are read and always have a folder.

    Args:
        cache: whether it is kept.
        literals: whether compiled callers that pass different numbers or flags as literals get a copy each.
        allocates: whether it makes arrays; one that does not need not count references, two for every array of
            every tuple it touches. It must return none either, for the caller drops a reference that was not taken.
        options: those of numba.

    Raises:
        OSError: no folder can be written to.
    """

    def compile_lazily(function: Function) -> Function:
        dispatcher: Any = numba.njit(**options | {"_nrt": allocates})(function)
        if cache:
            dispatcher._cache = _cache_of(function)
        if not literals:
            dispatcher.get_call_template = partial(_call_without_literals, dispatcher.get_call_template)
        compiled: Function = dispatcher
        return compiled

    return compile_lazily


def _call_without_literals(call: Callable[..., Any], types: tuple[Any, ...], named: dict[str, Any]) -> Any:
    return call(tuple(map(unliteral, types)), {name: unliteral(one) for name, one in named.items()})


class _CheckedFiles(IndexDataCacheFile):
    """The files of one function, each with the digest of its contents behind them, which pickle does not read."""

    def _load_index(self) -> Any:
        return super()._load_index() if _is_whole(self._index_path) else {}  # type: ignore[no-untyped-call]

    def _load_data(self, name: str) -> Any:
        if not _is_whole(os.path.join(self._cache_path, name)):
            raise FileNotFoundError(name)  # numba then compiles anew, and writes over it
        return super()._load_data(name)  # type: ignore[no-untyped-call]

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        contents = io.BytesIO()
        yield contents
        with super()._open_for_write(filepath) as file:
            file.write(contents.getvalue() + hashlib.sha256(contents.getvalue()).digest())


def _is_whole(path: str) -> bool:
    """True if a file can be read and ends with the digest of what comes before."""
    size = hashlib.sha256().digest_size
    try:
        contents = Path(path).read_bytes()
    except OSError:
        return False
    return hashlib.sha256(contents[:-size]).digest() == contents[-size:]


def _cache_of(function: Callable[..., Any]) -> FunctionCache:
    """Return where a function is kept."""
    try:
        cache = FunctionCache(function)
    except RuntimeError:  # numba has no folder
        os.environ[CACHE_DIR] = _temporary_folder()  # for processes that this one starts, too
        numba.config.reload_config()
        cache = FunctionCache(function)
    cache._cache_file.__class__ = _CheckedFiles
    return cache


def choose_folder() -> None:
    """Choose the folder that numba keeps compiled functions in, for processes that this one starts, too."""
    _cache_of(choose_folder)


def _temporary_folder() -> str:
    """Return the user's temporary folder for compiled functions, which other commands use again, and say so.

    What is in it is run, so one that others can write to is not used.
    """
    user = os.getuid()
    try:
        folder = Path(tempfile.gettempdir(), f"topo-search-{user}")
        folder.mkdir(0o700, exist_ok=True)
        status = folder.lstat()
        if not stat.S_ISDIR(status.st_mode) or status.st_uid != user or status.st_mode & 0o022:
            folder = Path(tempfile.mkdtemp(prefix=f"topo-search-{user}-"))
    except OSError as error:
        advice = f"compiled functions cannot be kept; set {CACHE_DIR} to a folder that can be written to"
        raise OSError(error.errno, error.strerror or str(error), advice) from None
    tell(
        f"compiled functions are kept in {folder}, because neither the installation nor the user's cache can be "
        f"written to; set {CACHE_DIR} to a folder that lasts"
    )
    return str(folder)


def is_kept(dispatcher: Any) -> bool:
    """True if a function was compiled before for this machine, and nothing that is kept of it is damaged."""
    files, machine = dispatcher._cache._cache_file, dispatcher.targetctx.codegen().magic_tuple()
    kept = [files._data_path(name) for (_, of, _), name in files._load_index().items() if of == machine]
    return bool(kept) and all(map(_is_whole, kept))


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
    sources = sorted(room.glob("*.py"))
    contents = b"".join(source.read_bytes() for source in (*sources, *_files(others)))
    digest = hashlib.sha256(contents).hexdigest().encode()
    folder = Path(dispatcher.stats.cache_path)
    mark = folder / f"{room.name}.sha256"
    if mark.exists() and mark.read_bytes() == digest:
        return True
    for source in sources:
        for kept in folder.glob(f"{source.stem}.*.nb[ci]"):
            kept.unlink(missing_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    written = folder / f"{room.name}.{os.getpid()}.partial"
    written.write_bytes(digest)
    written.replace(mark)
    return False


def _files(places: tuple[Path, ...]) -> Iterator[Path]:
    for path in places:
        yield from sorted(path.glob("*.py")) if path.is_dir() else (path,)
