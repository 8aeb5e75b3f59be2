"""Thousands of wrong tasks, designs and meshes: each is a named message with exit status 2, or a valid result.

No traceback, no hang, nothing written outside the folder, no program started, no other file opened.
"""

import json
import random
import struct
import subprocess
import sys
import tomllib
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from importlib import resources
from itertools import product
from pathlib import Path

import pytest
import tomli_w
import toy_problem
from click.testing import CliRunner
from mutations import Watch, as_json, ended_in_time, garbled, mutated_text, renumbered
from verify_cases import fan

from topo_search import compose
from topo_search.cli import main
from topo_search.model.files import examples, to_json

FULL = """\
name = "full"
modules = [3, 4]
[[load_cases]]
units = "SI"
end_effector = { force = [2.0, 0.0, 5.0], torque = [0.1, 0.0, 0.0] }
[[load_cases]]
com = { force = [0.0, 0.0, 10.0] }
units = "SI"
weight = 2.0
[[exposure]]
kind = "local"
vertices = [[0.1, 0.2, 0.0], [0.2, 0.1, 0.0], [-0.1, -0.1, 0.0], [0.0, 0.0, 0.3]]
[[exposure]]
kind = "local"
mesh = "box.obj"
[[exposure]]
kind = "directional"
segments = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
[[exposure]]
kind = "exterior"
axis = [0.0, 0.0, -1.0]
[module]
mass = 0.3
[module.body]
mesh = "box.stl"
inertia = [1e-3, 1e-3, 1e-3]
[module.airflow]
reach = 1.4
[end_effector]
position = [0.4, 0.0, 0.1]
[search]
margin = 1e-3
[tolerances]
hinge_angle_deg = 0.1
[goals]
clearance = [1e-4, 1e-3]
stand_off = [0.2, 0.3]
"""
HALVES = (0.04, 0.04, 0.02)
CORNERS = list(product(*((-half, half) for half in HALVES)))
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACETS = [(a, b, c) for a, b, c, _ in QUADS] + [(a, c, d) for a, _, c, d in QUADS]
OBJ = "".join([*("v {} {} {}\n".format(*corner) for corner in CORNERS), "mtllib other.mtl\n",
               *(f"f {a + 1}/1/1 {b - 8}//2 {c + 1} {d + 1}\n" for a, b, c, d in QUADS)]).encode()  # fmt: skip
BINARY = bytes(80) + struct.pack("<I", len(FACETS)) + b"".join(
    struct.pack("<12fH", 0, 0, 0, *(x for i in facet for x in CORNERS[i]), 0) for facet in FACETS
)  # fmt: skip
ASCII = "solid box\n" + "".join(
    "facet normal 0 0 0\nouter loop\n" + "".join("vertex {} {} {}\n".format(*CORNERS[i]) for i in facet)
    + "endloop\nendfacet\n" for facet in FACETS
) + "endsolid box\n"  # fmt: skip

TASKS = [FULL.encode()] * 10 + [
    (resources.files("topo_search") / "examples" / f"{name}.toml").read_bytes() for name in examples()
]
FRAME = {"vertices": [list(corner) for corner in CORNERS], "triangles": [list(facet) for facet in FACETS]}
DESIGNS = [
    to_json(design).encode()
    for design in (
        fan({"exposure": [{"kind": "local"}, {"kind": "directional", "segments": [[1.0, 0.0, 0.0]]}]}),
        fan({"exposure": [{"kind": "exterior"}, {"kind": "local", "box": [0.1, 0.1, 0.1]}]}, hinges=(0.0, 0.0)),
        fan({"module": {"body": {"inertia": [1e-3] * 3, "frame": [FRAME]}}, "tolerances": {"position": 0.01}}),
    )
]


@pytest.fixture(scope="module")
def watch(tmp_path_factory: pytest.TempPathFactory) -> Watch:
    """The folder that all of them work in, watched."""
    return Watch(tmp_path_factory.mktemp("mutations"))


@pytest.fixture
def folder(
    watch: Watch, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Path]:
    """An empty folder to work in, with nothing outside it touched."""
    place = Path(watch.folder)
    for path in place.iterdir():
        path.unlink()
    monkeypatch.chdir(place)
    monkeypatch.setattr(compose.binding, "Workers", toy_problem.InProcess)
    (place / "box.obj").write_bytes(OBJ)
    (place / "box.stl").write_bytes(BINARY)
    watch.seen.clear()
    yield place
    assert watch.seen == []


def told(watch: Watch, *words: str) -> tuple[int, str]:
    """Return the exit status of a command in this process, and its first message."""
    with warnings.catch_warnings(), ended_in_time(), watch.on():
        warnings.simplefilter("ignore")  # of numpy, about numbers that overflow
        result = CliRunner().invoke(main, list(words))
    assert result.exception is None or isinstance(result.exception, SystemExit), words
    if result.exit_code == 2:
        assert result.stderr.strip(), words
        assert all(len(line) < 1000 and line.isprintable() for line in result.stderr.splitlines()), result.stderr
    return result.exit_code, result.stderr


def task(rng: random.Random) -> tuple[str, bytes, tuple[str, ...]]:
    content = mutated_text(rng, rng.choice(TASKS), tomllib.loads, tomli_w.dumps)
    return "in.toml", content, ("check", "in.toml")


def design(rng: random.Random) -> tuple[str, bytes, tuple[str, ...]]:
    return "in.json", mutated_text(rng, rng.choice(DESIGNS), json.loads, as_json), ("audit", "in.json")


def mesh(rng: random.Random) -> tuple[str, bytes, tuple[str, ...]]:
    name, content = rng.choice((("box.obj", OBJ), ("box.stl", BINARY), ("box.stl", ASCII.encode())))
    changed = garbled(rng, content) if content == BINARY or rng.random() < 0.5 else renumbered(rng, content)
    region = f'[[exposure]]\nkind = "local"\nmesh = "{name}"\n'
    body = f'[module.body]\ninertia = [1e-3, 1e-3, 1e-3]\nmesh = "{name}"\n'
    head = 'name = "m"\nmodules = 2\n[[load_cases]]\ncom = { force = [0.0, 0.0, 1.0] }\n'
    Path("mesh.toml").write_text(head + rng.choice((region, body)))
    return name, changed, ("check", "mesh.toml")


def campaign(
    watch: Watch, make: Callable[[random.Random], tuple[str, bytes, tuple[str, ...]]], number: int, seed: int
) -> Counter[int]:
    """Return how many wrong files ended with which exit status; each can be made again from seed and number."""
    ended: Counter[int] = Counter()
    for each in range(number):
        rng = random.Random(f"{seed} {each}")
        name, content, words = make(rng)
        Path(name).write_bytes(content)
        try:
            status, _ = told(watch, *words)
        except BaseException:
            print(f"{make.__name__} {seed} {each}")
            raise
        ended[status] += 1
    return ended


@pytest.mark.parametrize(
    ("make", "number", "allowed"), [(task, 30, {0, 2}), (design, 30, {0, 1, 2}), (mesh, 30, {0, 2})]
)
def test_a_wrong_file_is_named_or_its_answer_valid(watch: Watch, folder: Path, make, number, allowed) -> None:
    ended = campaign(watch, make, number, seed=0)
    assert set(ended) <= allowed
    assert ended[2] > number / 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "number", "allowed"), [(task, 1000, {0, 2}), (design, 1000, {0, 1, 2}), (mesh, 500, {0, 2})]
)
def test_thousands_of_wrong_files(watch: Watch, folder: Path, make, number, allowed, capsys) -> None:
    ended = campaign(watch, make, number, seed=1)
    with capsys.disabled():
        print(f"\n{number} times {make.__name__}: {dict(sorted(ended.items()))}")
    assert set(ended) <= allowed


@pytest.mark.slow
def test_the_installed_command_says_the_same(watch: Watch, folder: Path) -> None:
    for make in (task, design, mesh):
        for each in range(10):
            name, content, words = make(random.Random(f"2 {each}"))
            Path(name).write_bytes(content)
            found = subprocess.run([sys.executable, "-m", "topo_search", *words], capture_output=True, timeout=120)
            status, said = told(watch, *words)
            assert found.returncode == status
            assert b"Traceback" not in found.stderr
            if status == 2:
                assert found.stderr.decode() == said
