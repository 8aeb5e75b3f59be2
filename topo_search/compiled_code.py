"""numba's on-disk cache of compiled functions: invalidation and location.

numba invalidates a cached function by the date of its source file only, not of the files that it calls or takes
constants from. So the cache is marked with a digest of all of these sources.

numba refuses to compile if neither NUMBA_CACHE_DIR, the installation nor the user's cache is writable, as in a
container without a home directory. Then a temporary folder is used.
"""

import hashlib
import os
import stat
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import FunctionCache
from numba.core.types import unliteral

from topo_search.model.value import BadInput
from topo_search.process import tell

Function = TypeVar("Function", bound=Callable[..., Any])

CACHE_DIR = "NUMBA_CACHE_DIR"
"""numba's environment variable for the cache folder."""


def njit(
    *, cache: bool, inner: bool = False, literals: bool = True, allocates: bool = True, **options: Any
) -> Callable[[Function], Function]:
    """Return a decorator like `numba.njit` whose cache always has a folder.

    Args:
        cache: True to cache the function on disk.
        inner: True for a function that only compiled functions call: it gets no entry from Python, which takes
            longer to compile than most functions if an argument is a record of many arrays.
        literals: True to compile a version for each literal number or flag that compiled callers pass.
        allocates: False for a function that neither creates nor returns arrays; this saves reference counting. If
            it returned an array, the caller would release a reference that was never taken.
        options: options of numba.

    Raises:
        BadInput: numba's compiler is switched off.
        OSError: no folder is writable.
    """
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        raise BadInput("NUMBA_DISABLE_JIT", "must be 0 or unset: without the compiler a search would take days")

    def compile_lazily(function: Function) -> Function:
        options.update(_nrt=allocates, no_cpython_wrapper=inner, no_cfunc_wrapper=True)
        dispatcher: Any = numba.njit(**options)(function)
        if cache:
            dispatcher._cache = _cache_of(function)
        if not literals:
            dispatcher.get_call_template = partial(_call_without_literals, dispatcher.get_call_template)
        compiled: Function = dispatcher
        return compiled

    return compile_lazily


def _call_without_literals(call: Callable[..., Any], types: tuple[Any, ...], named: dict[str, Any]) -> Any:
    return call(tuple(map(unliteral, types)), {name: unliteral(type_) for name, type_ in named.items()})


def _cache_of(function: Callable[..., Any]) -> FunctionCache:
    """Return the cache of a function."""
    try:
        return FunctionCache(function)
    except RuntimeError:  # numba has no folder
        os.environ[CACHE_DIR] = _temporary_folder()  # inherited by child processes
        numba.config.reload_config()
        return FunctionCache(function)


def _temporary_folder() -> str:
    """Return the user's temporary cache folder, which later commands reuse, and print its path.

    Its content is executed, so a folder that others can write to is not used.
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


def is_cached(dispatcher: Any) -> bool:
    """True if a function is cached for this machine."""
    machine = dispatcher.targetctx.codegen().magic_tuple()
    return any(target == machine for _, target, _ in dispatcher._cache._cache_file._load_index())


def refresh(dispatcher: Any, room: Path, *others: Path) -> None:
    """Delete the cached functions of a source folder unless they are up to date.

    Must be called before the first of the functions. At worst, concurrent processes delete each other's new files
    and compile once more.

    Args:
        dispatcher: one of the functions; it knows the cache folder.
        room: folder of the sources.
        others: further files or folders that the functions call or take constants from.
    """
    sources = sorted(room.glob("*.py"))
    called = [path for other in others for path in (sorted(other.glob("*.py")) if other.is_dir() else [other])]
    contents = b"".join(source.read_bytes() for source in (*sources, *called))
    digest = hashlib.sha256(contents).hexdigest().encode()
    folder = Path(dispatcher.stats.cache_path)
    mark = folder / f"{room.name}.sha256"
    if mark.exists() and mark.read_bytes() == digest:
        return
    for source in sources:
        for cached in folder.glob(f"{source.stem}.*.nb[ci]"):
            cached.unlink(missing_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    partial = folder / f"{room.name}.{os.getpid()}.partial"
    partial.write_bytes(digest)
    partial.replace(mark)
