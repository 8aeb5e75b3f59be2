"""Files of others: what is no regular file, too large or no text, and meshes that are none or name other files."""

import os
import signal
import struct
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import trimesh
from commands import invoke

from topo_search.limits import LIMITS
from topo_search.model import BadInput, Design, Task
from topo_search.model.files import read_json, validate, write_atomically
from topo_search.model.mesh_file import convex_pieces, surface
from topo_search.model.task_file import read_task

TASK = """\
name = "case"
modules = 3
[[load_cases]]
com = { force = [0.0, 0.0, 1.0] }
[[exposure]]
kind = "local"
mesh = "%s"
"""
FRAME = """\
name = "case"
modules = 3
[[load_cases]]
com = { force = [0.0, 0.0, 1.0] }
[module.body]
inertia = [1e-3, 1e-3, 1e-3]
mesh = "%s"
"""


@pytest.fixture(autouse=True)
def no_hang() -> Iterator[None]:
    """End a test that waits for a pipe."""
    before = signal.signal(signal.SIGALRM, lambda *_: pytest.fail("waits for a file"))
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def _task(path: Path) -> None:
    read_task(path)


def _design(path: Path) -> None:
    read_json(Design, path)


def _region(path: Path) -> None:
    task = path.parent / "task of a region.toml"
    task.write_text(TASK % path.name)
    read_task(task)


def _frame(path: Path) -> None:
    task = path.parent / "task of a frame.toml"
    task.write_text(FRAME % path.name)
    read_task(task)


READERS: dict[str, tuple[Callable[[Path], None], str, int]] = {
    "task": (_task, "in.toml", LIMITS.task_bytes),
    "design": (_design, "in.json", LIMITS.design_bytes),
    "region": (_region, "in.obj", LIMITS.mesh_bytes),
    "frame": (_frame, "in.stl", LIMITS.mesh_bytes),
}


def refusal(read: Callable[[Path], None], path: Path) -> str:
    with pytest.raises(BadInput) as refused:
        read(path)
    (fault,) = refused.value.faults
    return fault.rule


@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_regular_file_is_refused_and_not_waited_for(tmp_path: Path, reader: str) -> None:
    read, name, _ = READERS[reader]
    os.mkfifo(tmp_path / name)
    assert "must be a regular file, but is a pipe or a device" in refusal(read, tmp_path / name)
    (tmp_path / name).unlink()
    (tmp_path / name).mkdir()
    assert "must be a regular file, but is a folder" in refusal(read, tmp_path / name)


@pytest.mark.parametrize("reader", READERS)
def test_a_file_beyond_its_size_is_not_read(tmp_path: Path, reader: str) -> None:
    read, name, most = READERS[reader]
    with (tmp_path / name).open("wb") as stream:
        stream.truncate(2**40)
    assert f"must have at most {most:,} bytes, but has {2**40:,}" in refusal(read, tmp_path / name)


def test_the_first_byte_that_is_no_text_is_told(tmp_path: Path) -> None:
    (tmp_path / "in.toml").write_bytes(b"\xef\xbb\xbf" + "# ü\n".encode() + b"\xfc")
    assert refusal(_task, tmp_path / "in.toml") == "must be UTF-8 text, but got the byte 0xfc at offset 8"


def test_names_that_no_file_can_have_are_refused(tmp_path: Path) -> None:
    task = tmp_path / "task.toml"
    for form in (TASK, FRAME):
        task.write_text(form % ("n" * 5000 + ".obj"))
        assert "must be a file that can be read" in refusal(_task, task)


def test_a_message_cannot_write_to_the_terminal(tmp_path: Path) -> None:
    with pytest.raises(BadInput) as refused:
        read_task(tmp_path / "\x1b[31m\n.toml")
    assert r"\x1b[31m\n.toml: no such file" in str(refused.value)
    with pytest.raises(BadInput, match=r"^\ufffd.toml: no such file"):
        read_task(os.fsdecode(b"\xff.toml"))


def test_a_task_that_is_not_the_user_s_names_no_other_file(tmp_path: Path) -> None:
    (tmp_path / "box.obj").write_bytes(BOX)
    for form, field in ((TASK, "exposure[0].mesh"), (FRAME, "module.body.mesh")):
        (tmp_path / "task.toml").write_text(form % "box.obj")
        read_task(tmp_path / "task.toml")
        with pytest.raises(BadInput) as refused:
            validate(Task, tomllib.loads(form % "box.obj"), "task.toml")
        assert [fault.path for fault in refused.value.faults] == [field]


# ---- meshes

CORNERS = [(x, y, z) for x in (-1, 1) for y in (-2, 2) for z in (-3, 3)]
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def obj(corner: Callable[[int], str], *before: str) -> bytes:
    """A box as an OBJ, each facet after its vertices."""
    lines = [*before, *(f"v {x} {y} {z}" for x, y, z in CORNERS)]
    return "\n".join([*lines, *("f " + " ".join(map(corner, quad)) for quad in QUADS)]).encode()


BOX = obj(lambda i: f"{i + 1}")
TRIANGLES = [(a, b, c) for a, b, c, d in QUADS] + [(a, c, d) for a, b, c, d in QUADS]
RECORDS = b"".join(struct.pack("<12fH", 0, 0, 0, *(x for i in facet for x in CORNERS[i]), 0) for facet in TRIANGLES)
BINARY = b"solid in name only".ljust(80) + struct.pack("<I", len(TRIANGLES)) + RECORDS
ASCII = "\n".join(
    f"facet normal 0 0 0\n outer loop\n{corners}\n endloop\nendfacet"
    for facet in TRIANGLES
    for corners in ["\n".join("  vertex {} {} {}".format(*CORNERS[i]) for i in facet)]
)


FORMS = {
    "box.obj": BOX,
    "both.obj": obj(lambda i: f"{i - 8}/-1/-2", "# v 9 9 9", "vt 0 0", "vn 0 0 1", "usemtl red", "s off", "l 1 2"),
    "blocks.obj": obj(lambda i: f"{i - 8}") + b"\nv 9 9 9",
    "coloured.obj": BOX.replace(b"3\nv", b"3 0.5 0.5 0.5 0 0 1\nv"),
    "continued.obj": BOX.replace(b" ", b" \\\n").replace(b"\n", b"\r\n"),
    "marked.obj": b"\xef\xbb\xbf" + BOX.replace(b" ", b"\t").replace(b"\n", b"\r\n  "),
    "twice.obj": BOX + b"\nf 1 2 4 3",
    "binary.stl": BINARY,
    "nan-normals.stl": f"solid\n{ASCII}\nendsolid".replace("normal 0 0 0", "normal -nan(ind) x").encode(),
    "latin.stl": f"solid \xfc\n{ASCII.upper()}\nendsolid \xfc".replace("\n", "\r\n").encode("latin-1"),
    "facet.STL": f"solid a facet\n{ASCII}\nendsolid a facet".encode(),
    "two.stl": f"solid\n{ASCII}\nendsolid\nsolid b\n{ASCII}\nendsolid b".encode(),
}


@pytest.mark.parametrize("name", FORMS)
def test_a_box_reads_as_a_box_in_every_form(tmp_path, name):
    (tmp_path / name).write_bytes(FORMS[name])
    mesh = surface(tmp_path / name)
    (corners,), (excess,) = convex_pieces(mesh)
    assert corners.tolist() == [list(map(float, corner)) for corner in sorted(CORNERS)]
    assert excess == 0
    area = trimesh.Trimesh(*mesh[:2], process=False).area
    assert area == pytest.approx(88 * {"two.stl": 2}.get(name, 1) + 24 * (name == "twice.obj"))


@pytest.mark.parametrize(
    ("name", "content", "rule"),
    [
        ("a.obj", BOX.replace(b"-3", b"-3,0", 1), 'but got "v -1 -2 -3,0"'),
        ("a.obj", BOX + b"\nf 1 2 9", "must have corners 1 to 8"),
        ("a.obj", b"curv 0 1 1 2\n", "must be an OBJ of vertices and facets, but has `curv`"),
        ("a.obj", b"v 0 0 0\nv 0 0 0\nv 0 0 0\n" + b"f 1 2 3\n" * (LIMITS.facets + 1), "at most 100,000 facets"),
        ("a.stl", b"", "must be a whole STL file, but no facet can be read"),
        ("a.stl", BINARY[:-1], "must be a whole STL file, but no facet can be read"),
        ("a.stl", f"solid\n{ASCII}"[: len(ASCII) // 2].encode(), "must be a whole STL file, but "),
        ("a.stl", b"<!doctype html>\n<title>Sign in</title>\n" * 5, "must be a whole STL file, but no facet"),
    ],
)
def test_a_mesh_that_is_none_is_named(tmp_path: Path, name: str, content: bytes, rule: str) -> None:
    (tmp_path / name).write_bytes(content)
    for read in (_region, _frame):
        assert rule in refusal(read, tmp_path / name)


def test_a_frame_has_few_triangles_and_pieces(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=5)
    assert len(ball.faces) > LIMITS.frame_triangles
    (tmp_path / "ball.stl").write_bytes(ball.export(file_type="stl"))
    assert "must have at most 5,000 triangles, but has 20,480" in refusal(_frame, tmp_path / "ball.stl")
    crumb = trimesh.creation.box((0.1, 0.1, 0.1))
    crumbs = [crumb.copy().apply_translation([k, 0, 0]) for k in range(101)]
    trimesh.util.concatenate(crumbs).export(tmp_path / "crumbs.obj")
    assert "must have at most 100 pieces, but has 101" in refusal(_frame, tmp_path / "crumbs.obj")


# ---- what is written


def test_a_device_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="exists, but is not a regular file"):
        write_atomically(tmp_path / "pipe", "text")
    for words in (
        ["init", str(tmp_path / "pipe"), "--force"],
        ["export", "none.json", "--format", "stl", "--out", str(tmp_path / "pipe")],
    ):
        assert "must be a regular file" in invoke(*words, status=2).stderr
    assert (tmp_path / "pipe").is_fifo()


KILLED = """
import os, signal, sys
from pathlib import Path
from topo_search.model.files import write_atomically
os.fsync = lambda handle: os.kill(os.getpid(), signal.SIGKILL)
write_atomically(Path(sys.argv[1]), "half of it")
"""


def test_a_killed_process_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "design.csv"
    path.write_text("old")
    assert subprocess.run([sys.executable, "-c", KILLED, path], check=False).returncode == -signal.SIGKILL
    assert path.read_text() == "old"


def test_a_file_is_replaced(tmp_path: Path) -> None:
    for text in ("first", "second"):
        write_atomically(tmp_path / "design.csv", text)
        assert [each.read_text() for each in tmp_path.iterdir()] == [text]
