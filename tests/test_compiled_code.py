"""What numba keeps of compiled code: dropped when a source changes, made anew when damaged, and kept somewhere."""

import errno
import os
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numba
import pytest

import nlp.air.program_rows
import nlp.bounds.branch.search
import nlp.reduced.platform
import nlp.starts.reduced_starts
import verify.proof.check
from topo_search.compiled_code import CACHE_DIR, is_cached, njit, refresh
from topo_search.model import BadInput


@pytest.fixture
def place(tmp_path):
    """A folder of sources, one of what is kept, and a file that constants come from."""
    room, kept, other = tmp_path / "room", tmp_path / "kept", tmp_path / "constants.py"
    room.mkdir()
    for name in ("one", "two"):
        (room / f"{name}.py").write_text(f"# {name}\n")
    other.write_text("A = 1\n")
    return room, kept, other


def test_what_was_made_from_other_sources_is_dropped(place):
    room, kept, other = place
    function = SimpleNamespace(stats=SimpleNamespace(cache_path=str(kept)))
    refresh(function, room, other)
    files = [kept / name for name in ("one.f-1.py311.nbi", "two.g-3.py311.1.nbc", "another.h-2.py311.nbc")]

    def compiled():
        for file in files:
            file.touch()

    def left():
        return [file.exists() for file in files]

    compiled()
    assert left() == [True, True, True]
    refresh(function, room, other)
    assert left() == [True, True, True]
    (room / "two.py").write_text("# changed\n")
    refresh(function, room, other)
    assert left() == [False, False, True]
    compiled()
    other.write_text("A = 2\n")
    refresh(function, room, other)
    assert left() == [False, False, True]
    assert sorted(path.suffix for path in kept.iterdir()) == [".nbc", ".sha256"]


def test_all_rooms_of_compiled_code_are_marked():
    for module, function in (
        (nlp.air.program_rows, nlp.air.program_rows.derive_speeds),
        (nlp.reduced.platform, nlp.reduced.platform.platform),
        (nlp.starts.reduced_starts, nlp.starts.reduced_starts.place_starts),
        (nlp.bounds.branch.search, nlp.bounds.branch.search.search),
        (verify.proof.check, verify.proof.check.replay.replay),
    ):
        room = Path(str(module.__file__)).parent
        assert (Path(str(function.stats.cache_path)) / f"{room.name}.sha256").exists()


SOURCE = """
from topo_search.compiled_code import njit

@njit(cache=True)
def double(x):
    return 2.0 * x
"""


@pytest.fixture
def load(tmp_path, monkeypatch):
    """Load a compiled function as a new process does; what is kept of it is in `load.folder`."""
    source = tmp_path / "doubling.py"
    source.write_text(SOURCE)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kept"))

    def double():
        names = {"__name__": "doubling"}
        exec(compile(SOURCE, str(source), "exec"), names)
        return names["double"]

    return double


def test_what_is_kept_serves_the_next_process(load):
    first = load()
    assert not is_cached(first)
    assert first(21.0) == 42.0
    again = load()
    assert is_cached(again)
    assert again(21.0) == 42.0
    assert again.stats.cache_hits


def test_a_function_is_compiled_once_for_all_numbers_that_callers_write_out():
    @njit(cache=False, literals=False)
    def shifted(x, by):
        return x + by

    @njit(cache=False)
    def caller(x):
        return shifted(x, 1) + shifted(x, 2)

    assert caller(0) == 3
    assert len(shifted.signatures) == 1


# ---- where nothing can be kept


@pytest.fixture
def read_only(load, tmp_path, monkeypatch):
    """Neither the installation nor the user's cache can be written to."""

    def refuse(locator):
        raise PermissionError

    for locator in (numba.core.caching.InTreeCacheLocator, numba.core.caching.UserWideCacheLocator):
        monkeypatch.setattr(locator, "ensure_cache_path", refuse)
    monkeypatch.delenv(CACHE_DIR, raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    numba.config.reload_config()
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    yield load
    os.environ.pop(CACHE_DIR, None)
    numba.config.reload_config()


def test_a_temporary_folder_serves_where_nothing_can_be_written_to(read_only, tmp_path, capfd):
    assert read_only()(21.0) == 42.0
    folder = tmp_path / f"topo-search-{os.getuid()}"
    assert os.environ[CACHE_DIR] == str(folder)
    assert folder.stat().st_mode & 0o777 == 0o700
    again = read_only()
    assert again(21.0) == 42.0
    assert again.stats.cache_hits
    (line,) = capfd.readouterr().err.splitlines()
    assert str(folder) in line
    assert CACHE_DIR in line


def test_a_temporary_folder_that_others_can_write_to_is_not_used(read_only, tmp_path):
    folder = tmp_path / f"topo-search-{os.getuid()}"
    folder.mkdir()
    folder.chmod(0o777)
    assert read_only()(21.0) == 42.0
    assert os.environ[CACHE_DIR] != str(folder)
    assert list(folder.iterdir()) == []


def test_no_folder_at_all_is_said(read_only, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", "/dev/null")
    with pytest.raises(OSError, match=CACHE_DIR) as caught:
        read_only()
    assert caught.value.errno == errno.ENOTDIR


def test_a_compiler_that_is_switched_off_is_said(monkeypatch):
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 1)
    with pytest.raises(BadInput, match="NUMBA_DISABLE_JIT"):
        njit(cache=False)
