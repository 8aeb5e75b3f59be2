"""Files of others: what is no regular file, too large or no text, and meshes that are none or name other files."""

import os
import signal
import socket
import struct
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from commands import invoke

from topo_search.limits import LIMITS
from topo_search.model import BadInput, Design, Task
from topo_search.model.files import read_json, read_task, validate, write_atomically
from topo_search.model.mesh_file import convex_pieces, surface

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
@pytest.mark.parametrize("kind", ["a pipe", "a folder", "a socket", "a character device"])
def test_what_is_no_regular_file_is_refused_and_not_waited_for(tmp_path: Path, reader: str, kind: str) -> None:
    read, name, _ = READERS[reader]
    path = tmp_path / name
    with socket.socket(socket.AF_UNIX) as listening:
        match kind:
            case "a pipe":
                os.mkfifo(path)
            case "a folder":
                path.mkdir()
            case "a socket":
                listening.bind(str(path))
            case _:
                path.symlink_to("/dev/zero")
        assert f"must be a regular file, but is {kind}" in refusal(read, path)


@pytest.mark.parametrize("reader", READERS)
def test_a_file_beyond_its_size_is_not_read(tmp_path: Path, reader: str) -> None:
    read, name, most = READERS[reader]
    with (tmp_path / name).open("wb") as stream:
        stream.truncate(2**40)
    assert f"must have at most {most:,} bytes, but has {2**40:,}" in refusal(read, tmp_path / name)


@pytest.mark.parametrize("reader", ["task", "design"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_the_first_byte_that_is_no_text_is_told(tmp_path: Path, reader: str, mark: bytes) -> None:
    read, name, _ = READERS[reader]
    content = mark + "# ü\n".encode() + b"\xfc"
    (tmp_path / name).write_bytes(content)
    told = f"must be UTF-8 text, but got the byte 0xfc at offset {len(content) - 1}"
    assert refusal(read, tmp_path / name) == told


def test_names_that_no_file_can_have_are_refused(tmp_path: Path) -> None:
    task = tmp_path / "task.toml"
    for form in (TASK, FRAME):
        task.write_text(form % r"zero\u0000byte.stl")
        assert "must have a name that a file can have" in refusal(_task, task)
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


@pytest.mark.parametrize(
    ("name", "content"),
    {
        "box.obj": BOX,
        "backwards.obj": obj(lambda i: f"{i - 8}"),
        "textured.obj": obj(lambda i: f"{i + 1}/7", "mtllib other.mtl", "usemtl red", "vt 0 0"),
        "normal.obj": obj(lambda i: f"{i + 1}//9", "o thing", "g part", "s off", "vn 0 0 1"),
        "both.obj": obj(lambda i: f"{i - 8}/-1/-2", "# v 9 9 9", "l 1 2"),
        "coloured.obj": obj(lambda i: f"{i - 8}", "v 1 1 1e0 0.5 0.5 0.5", "v 1 1 1. 1.0"),
        "continued.obj": BOX.replace(b" ", b" \\\n").replace(b"\n", b"\r\n"),
        "slash.obj": obj(lambda i: f"{i + 1}//"),
        "slashes.obj": obj(lambda i: f"{i + 1}/1/", "vt 0 0"),
        "mixed.obj": obj(lambda i: f"{i + 1}" + ("//", "/1/", "/", "//1", "/1/1")[i % 5], "vt 0 0", "vn 0 0 1"),
        "nan.obj": obj(lambda i: f"{i - 8}").replace(b"3\nv", b"3 nan nan nan\nv"),
        "marked.obj": b"\xef\xbb\xbf" + BOX,
        "ended.obj": obj(lambda i: f"{i + 1}").replace(b"\nf", b"\nend\nf", 1) + b"\r\n\x1a\0\r\n",
        "normals.obj": BOX.replace(b"3\nv", b"3 0.5 0.5 0.5 0 0 1\nv"),
        "ended.stl": f"solid\n{ASCII}\nendsolid\x1a".encode(),
        "tabs.obj": BOX.replace(b" ", b"\t"),
        "indented.obj": BOX.replace(b"\n", b"\n  "),
        "old.obj": BOX.replace(b"\n", b"\r"),
        "blocks.obj": obj(lambda i: f"{i - 8}") + b"\nv 9 9 9",
        "unused.obj": b"v 9 9 9\n" + obj(lambda i: f"{i + 2}"),
        "binary.stl": BINARY,
        "trailing.stl": BINARY + bytes(16),
        "behind.stl": BINARY + b"solid\nfacet",
        "unended.stl": f"solid\n{ASCII}".encode(),
        "old.stl": f"solid vertex\n{ASCII}\nendsolid".replace("\n", "\r").encode(),
        "one-line.stl": ("solid\n" + " ".join(ASCII.split()) + "\nendsolid").encode(),
        "nan-normals.stl": f"solid\n{ASCII}\nendsolid".replace("normal 0 0 0", "normal -nan(ind) x").encode(),
        "latin.stl": f"solid \xfc\n{ASCII}\nendsolid \xfc".encode("latin-1"),
        "ascii.STL": f"solid a facet\n{ASCII}\nendsolid a facet".encode(),
        "upper.stl": f"SOLID\n{ASCII.upper()}\nENDSOLID".replace("\n", "\r\n").encode(),
        "two.stl": f"solid\n{ASCII}\nendsolid\nsolid b\n{ASCII}\nendsolid b".encode(),
    }.items(),
)
def test_a_box_reads_as_a_box_in_every_form(tmp_path, caplog, name, content):
    (tmp_path / name).write_bytes(content)
    mesh = surface(tmp_path / name)
    (corners,), (excess,) = convex_pieces(mesh)
    assert corners.tolist() == [list(map(float, corner)) for corner in sorted(CORNERS)]
    assert excess == 0
    assert not caplog.records  # trimesh complains in the log
    vertices, triangles, _ = mesh
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    assert mesh.area / 2 == pytest.approx((8 + 12 + 24) * (2 if name == "two.stl" else 1))


def test_an_stl_with_more_facets_than_its_header_says_is_refused(tmp_path: Path) -> None:
    """A second body behind the first would be lost without a word."""
    facet = struct.pack("<12fH", 0, 0, 1, 0, 0, 5, 1, 0, 5, 0, 1, 5, 0)
    (tmp_path / "more.stl").write_bytes(BINARY + 4 * facet)
    with pytest.raises(ValueError, match="as many facets as its header says"):
        surface(tmp_path / "more.stl")


def test_a_mesh_opens_no_other_file(tmp_path: Path) -> None:
    """Neither the library of materials, nor its textures, nor anything else that an OBJ may name."""
    os.mkfifo(tmp_path / "pipe.mtl")
    (tmp_path / "m.mtl").write_text("newmtl red\nmap_Kd huge.png\n")
    (tmp_path / "huge.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    (tmp_path / "names.obj").write_bytes(
        b"mtllib pipe.mtl m.mtl\nmaplib a.map\nshadow_obj pipe.mtl\nusemtl red\nvt 0 0\n" + BOX
    )
    opened: list[str] = []
    seen = [True]
    sys.addaudithook(lambda event, given: opened.append(str(given[0])) if event == "open" and seen[0] else None)
    surface(tmp_path / "names.obj")
    seen[0] = False
    assert [name for name in opened if str(tmp_path) in name] == [str(tmp_path / "names.obj")]


@pytest.mark.parametrize(
    ("name", "content", "rule"),
    [
        ("a.obj", b"v 0 0\n", "must have three numbers per vertex, but got 2 (line 1)"),
        ("a.obj", b"v 0 0 0 v 1 0 0\n", 'must have a line per vertex and facet, but got "v" (line 1)'),
        ("a.obj", BOX + b"\x1a\n" + BOX, "must have the number of a vertex for a corner, but got"),
        ("a.obj", b"v 0 0 nan\n", 'must have numbers for coordinates, but got "nan" (line 1)'),
        ("a.obj", b"v 0 0 " + b"9" * 5000, "must have numbers for coordinates, but got"),
        ("a.obj", BOX + b"\nf 1 2", "must have at least three corners per facet, but got 2 (line 15)"),
        ("a.obj", BOX + b"\nf 0 1 2", "must have the number of a vertex before it, 1 to 8, but got 0 (line 15)"),
        ("a.obj", BOX + b"\nf 1 2 x", 'must have the number of a vertex for a corner, but got "x" (line 15)'),
        ("a.obj", BOX + b"\nf 1 2 " + b"1" * 20, "must have the number of a vertex for a corner"),
        ("a.obj", b"curv 0 1 1 2\n", 'must be an OBJ of vertices and facets, but has "curv" (line 1)'),
        ("a.obj", b"\x89PNG\r\n\x1a\n", "must be an OBJ of vertices and facets, but has"),
        ("a.obj", b"#\n" * (10 * LIMITS.facets + 2), "must have at most 1,000,000 lines, but has more"),
        (
            "a.obj",
            b"v 0 0 0\nv 0 0 0\nv 0 0 0\n" + b"f 1 2 3\n" * (LIMITS.facets + 1),
            "must have at most 100,000 facets",
        ),
        (
            "a.stl",
            b"",
            "must be a whole STL file: 84 bytes and 50 per facet; this one has too few bytes for a header",
        ),
        ("a.stl", BINARY.replace(b"solid", b"salad")[:-1], "this one has 683 bytes for 12 facets"),
        ("a.stl", BINARY[:84] + np.full(150, np.nan, "<f4").tobytes(), "must be the mesh of a body with a volume"),
        ("a.stl", b"solid\n" + b"endfacet\n" * 10**6, "must have at most 100,000 facets"),
        ("a.stl", f"solid\n{ASCII}\nfacet".encode(), "13 `facet`, 36 `vertex` and 12 `endfacet`"),
        ("a.stl", f"solid\n{ASCII}"[:-10].encode(), "must be a whole ASCII STL"),
        ("a.stl", f"solid\n{ASCII}".replace(" -3", "", 1).encode(), 'but got "vertex -1 -2"'),
        ("a.stl", f"solid\n{ASCII.replace('vertex -1', 'vertex inf', 1)}".encode(), 'but got "vertex inf'),
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


@pytest.mark.skipif(not hasattr(os, "O_TMPFILE"), reason="files without a name are Linux's")
def test_a_killed_process_leaves_no_part_of_a_file(tmp_path: Path) -> None:
    """The old file stays as it was, and nothing is beside it."""
    path = tmp_path / "design.csv"
    path.write_text("old")
    assert subprocess.run([sys.executable, "-c", KILLED, path], check=False).returncode == -signal.SIGKILL
    assert [(each.name, each.read_text()) for each in tmp_path.iterdir()] == [("design.csv", "old")]


def test_without_unnamed_files_a_file_is_replaced_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("topo_search.model.files.DESCRIPTORS", tmp_path / "none")
    for text in ("first", "second"):
        write_atomically(tmp_path / "design.csv", text)
        assert [each.read_text() for each in tmp_path.iterdir()] == [text]


def test_a_log_that_calls_itself_a_regular_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A pipe that nothing comes through, taken for a regular file, stands for the log of a kernel."""
    monkeypatch.setattr("topo_search.model.text._require_regular", lambda status, most_bytes: None)
    os.mkfifo(tmp_path / "log.json")
    with open(tmp_path / "log.json", "r+b", buffering=0), pytest.raises(BadInput, match="reading it would wait"):
        read_json(Design, tmp_path / "log.json")
