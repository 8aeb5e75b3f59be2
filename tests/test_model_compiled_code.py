"""What numba keeps of compiled code is dropped when a source that it was made from changes."""

from pathlib import Path
from types import SimpleNamespace

import pytest

import nlp.assembled
import nlp.bounds.branch.proof
import nlp.reduced.platform
import verify.proof.check
from topo_search.model.compiled_code import refresh


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
    assert not refresh(function, room, other)

    def compiled():
        names = ("one.f-1.py311.nbi", "two.g-3.py311.1.nbc", "another.h-2.py311.nbc")
        for name in names:
            (kept / name).touch()
        return [(kept / name).exists() for name in names]

    def left():
        return [
            (kept / name).exists() for name in ("one.f-1.py311.nbi", "two.g-3.py311.1.nbc", "another.h-2.py311.nbc")
        ]

    assert all(compiled())
    assert refresh(function, room, other)
    assert left() == [True, True, True]
    (room / "two.py").write_text("# changed\n")
    assert not refresh(function, room, other)
    assert left() == [False, False, True]
    compiled()
    other.write_text("A = 2\n")
    assert not refresh(function, room, other)
    assert left() == [False, False, True]
    assert refresh(function, room, other)
    assert sorted(path.suffix for path in kept.iterdir()) == [".nbc", ".sha256"]


def test_all_rooms_of_compiled_code_are_marked():
    for module, function in (
        (nlp.assembled, nlp.assembled.smooth_least),
        (nlp.reduced.platform, nlp.reduced.platform.platform),
        (nlp.bounds.branch.proof, nlp.bounds.branch.proof.search),
        (verify.proof.check, verify.proof.check.ends.replay),
    ):
        room = Path(str(module.__file__)).parent
        assert (Path(str(function.stats.cache_path)) / f"{room.name}.sha256").exists()
