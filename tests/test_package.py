"""The package as it is shipped: schemas are current, and the wheel holds all data and runs the first task."""

import ast
import io
import json
import math
import os
import shutil
import subprocess
import sys
import tokenize
import tomllib
import zipfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from topo_search.compose import binding
from topo_search.compose.shared_kit import Change, SharedKit
from topo_search.export.allocation import allocation
from topo_search.model import Design
from topo_search.model.files import read_json, to_json, to_toml
from topo_search.model.relaxed import Relaxation, Relaxed
from topo_search.model.task_file import examples, read_task, task_template
from topo_search.model.vehicle import Vehicle
from topo_search.simulation.result import FlightResult
from verify import audit
from verify.flight.vehicle import capability

ROOT = Path(__file__).parents[1]
MUTANTS = tomllib.loads((ROOT / "tests/mutants/mutants.toml").read_text(encoding="utf-8"))["mutant"]
sys.path.insert(0, str(ROOT / "tests/benchmarks"))

from keep_schemas import FOLDER, MODELS, schemas  # noqa: E402

ROTOR = {"z_m": 0.0, "ax": 0, "ay": 0, "az": 1, "k_f": 1.0, "k_tau": 0.1, "u_max": 5.0}
CHANGE = Change(before="a", after="b", undo=0, bolt=0, undo_steps=(), bolt_steps=(), stay=((0, 1),))
PACKAGES = ("topo_search", "nlp", "verify")


def without_words(schema):
    """Return a schema without its descriptions: fields, types, ranges and defaults have to be current."""
    if isinstance(schema, list):
        return [without_words(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    return {
        name: without_words(each)
        for name, each in schema.items()
        if name != "description" or not isinstance(each, str)
    }


def test_the_schemas_are_those_of_the_models():
    kept = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in FOLDER.glob("*.json")}
    due = {name: json.loads(text) for name, text in schemas().items()}
    assert without_words(kept) == without_words(due), "stale: run python tests/benchmarks/keep_schemas.py"


def written_files():
    """Yield files of every kind as the package writes them, each with the name of its schema."""
    yield from (("task", tomllib.loads(task_template("task", full=True))),)
    yield from (("task", tomllib.loads(to_toml(read_task(name)))) for name in examples())
    designs = [read_json(Design, path) for path in sorted((ROOT / "tests/designs").glob("*.json"))]
    wall_push = read_json(Design, ROOT / "tests/designs/wall-push.json")
    rotors = [
        {**ROTOR, "x_m": x, "y_m": y, "spin": spin}
        for x, y, spin in ((1, 0, 1), (0, 1, -1), (-1, 0, 1), (0, -1, -1))
    ]
    relaxation = Relaxation(topology_key="a10", limit="rod", change="10 %", field="end_effector.rod", share=0.1)
    yield from (("design", json.loads(to_json(design))) for design in designs)
    values = {
        "audit": audit(wall_push),
        "allocation": allocation(wall_push),
        "capability": capability(Vehicle(rotors=rotors)),
        "flight": read_json(FlightResult, ROOT / "notebooks/results/flight-wall-push.json"),
        "relaxed": Relaxed(modules=2, starts=8, relaxations=(relaxation,), in_vain=("rotor limits",)),
        "kit": SharedKit(
            within_percent=2.0, modules=2, tasks=(), brackets=(), changes=(CHANGE,), designs_kept=(1, 1)
        ),
    }
    yield from ((name, json.loads(to_json(value))) for name, value in values.items())


def test_the_schemas_allow_what_is_written():
    kept = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in FOLDER.glob("*.json")}
    found = {name: [] for name in kept}
    for name, data in written_files():
        found[name] += [error.message for error in Draft202012Validator(kept[name]).iter_errors(data)]
    assert found == {name: [] for name in MODELS}
    for schema in kept.values():
        Draft202012Validator.check_schema(schema)
        assert not Draft202012Validator(schema).is_valid({"format": "another"})


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Build the wheel with the pinned build tools."""
    out = tmp_path_factory.mktemp("wheel")
    pip(sys.executable, "wheel", "--no-deps", "--wheel-dir", str(out), str(ROOT))
    (built,) = out.glob("*.whl")
    return built


def pip(python, *words):
    pins = str(ROOT / "constraints.txt")
    environment = {**os.environ, "PIP_CONSTRAINT": pins, "PIP_BUILD_CONSTRAINT": pins}
    command = [str(python), "-m", "pip", *words[:1], "--quiet", "--disable-pip-version-check", *words[1:]]
    subprocess.run(command, check=True, env=environment)


@pytest.mark.slow
def test_the_wheel_holds_every_file_of_the_packages(wheel):
    held = set(zipfile.ZipFile(wheel).namelist())
    due = {
        str(path.relative_to(ROOT))
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.suffix in (".py", ".toml", ".json", ".j2", ".js", ".css") or path.name == "py.typed"
    }
    assert due <= held
    assert {f"{package}/py.typed" for package in PACKAGES} <= held
    assert {"topo_search/examples/push.toml", "topo_search/schemas/task.json"} <= held
    assert "topo_search/report/templates/page.html.j2" in held
    assert not [name for name in held if name.startswith(("tests/", "docs/"))]


@pytest.mark.slow
def test_the_first_task_runs_from_the_wheel_in_a_fresh_environment(wheel, tmp_path):
    subprocess.run([sys.executable, "-m", "venv", str(tmp_path / "fresh")], check=True)
    pip(tmp_path / "fresh/bin/python", "install", str(wheel))
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    command = [str(tmp_path / "fresh/bin/topo-search"), "run", "push"]
    done = subprocess.run(command, cwd=tmp_path, env=clean, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "best design: a70010, 5 modules" in done.stdout
    (page,) = tmp_path.glob("runs/push-*/report.html")
    assert page.stat().st_size > 1_000_000


# ---- Functions are named by what they do or return: a verb or a noun, never a participle or an adjective alone.

IRREGULAR = (
    "begun bent born bought broken built caught chosen drawn driven fed felt flown forgotten found frozen "
    "given gone  grown heard held hidden hung kept known laid learnt led left lent lost made meant met paid "
    "proven said seen sent  shown shrunk sold spent spoken stood stuck sunk swept taken taught thought thrown "
    "told torn understood won worn  woven written"
)
"""Those that are spelt like their verbs (`put`, `read`, `set`) or like nouns (`bound`) are left out."""
ADJECTIVES = (
    "alike bad common consistent deep different distinct due empty exhaustive few finite foreign harmless heavy "
    "idle informative long lossy lopsided noisy possible previous printable relevant same short solvable straight "
    "unchanged unseen whole wide wrong"
)
OTHERS = (
    "above across again along always another apart around aside away below beside better between beyond everyone "
    "far inside inwards nothing outside outwards over together towards why within without"
)
"""Adverbs, prepositions and pronouns; `at`, `of` and `to` before what a function is asked for stay."""
NO_PARTICIPLES = ("breed", "embed", "feed", "need", "proceed", "seed", "speed")
PARTICLES = ("again", "as", "at", "by", "from", "here", "in", "of", "on", "out", "to", "with", "within")
TERMS = {
    "rooted_at": "a rooted tree is what graph theory calls it",
    "rooted_of": "the same",
    "settled": "of `Observer`, which users implement: public names stay",
}


BLANK = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)


def core_contract() -> dict[str, list[str]]:
    """Return the contract of import-linter that separates core and features."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    (contract,) = (each for each in settings["contracts"] if each["name"] == "core imports no feature")
    return contract


def is_participle(word: str) -> bool:
    """Return whether a word is the past participle of a verb."""
    return word in IRREGULAR.split() or (word.endswith("ed") and word not in NO_PARTICIPLES)


def says_neither_verb_nor_noun(name: str) -> bool:
    """Return whether a name is a participle, or an adjective or adverb that nothing follows."""
    first, *rest = name.strip("_").split("_")
    if is_participle(first):
        return not rest or rest[0] in PARTICLES
    return not rest and first in (*ADJECTIVES.split(), *OTHERS.split())


def functions() -> Iterator[tuple[str, str]]:
    """Yield file and name of every function; properties, like fields, may be adjectives."""
    for package in ("nlp", "topo_search", "verify"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                    how = {ast.unparse(each).rsplit(".", 1)[-1] for each in node.decorator_list}
                    if not how & {"property", "cached_property"}:
                        yield str(path.relative_to(ROOT)), node.name


def test_functions_are_verbs_or_nouns() -> None:
    wrong = [f"{file}: {name}" for file, name in functions() if says_neither_verb_nor_noun(name)]
    assert [each for each in wrong if each.split(": ")[1] not in TERMS] == []
    assert {each.split(": ")[1] for each in wrong} == TERMS.keys()  # no term is listed that nothing needs


def test_no_two_classes_share_a_name() -> None:
    count = Counter(
        node.name
        for package in ("topo_search", "nlp", "verify")
        for path in (ROOT / package).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    )
    assert [name for name, times in count.items() if times > 1] == []


def test_every_module_is_core_or_a_feature() -> None:
    contract = core_contract()
    sources, features = set(contract["source_modules"]), set(contract["forbidden_modules"])
    modules = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for package in ("nlp", "topo_search", "verify")
        for path in (ROOT / package).rglob("*.py")
        if path.name not in ("__init__.py", "features.py") and path.parent.name not in ("cli", "compose")
    }
    where = {
        module: [name for name in sources | features if f"{module}.".startswith(f"{name}.")] for module in modules
    }
    kinds = {module: {name in features for name in names} for module, names in where.items()}
    assert {module: where[module] for module in modules if len(kinds[module]) != 1} == {}
    assert {module for module in modules if kinds[module] == {False}} <= sources  # one by one, for their order


def imports_from(module: str) -> Iterator[tuple[str, str]]:
    """Yield module and name of every import of a module."""
    path = ROOT / module.replace(".", "/")
    text = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text(encoding="utf-8")
    nodes = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom))
    yield from ((node.module or "", alias.name) for node in nodes for alias in node.names)


def test_the_core_takes_what_features_define_from_their_lists() -> None:
    contract = core_contract()
    handed_on = {
        (package, name)
        for package in ("topo_search.model", "topo_search.engine", "topo_search.study", "topo_search.topologies")
        for module, name in imports_from(package)
        if module in contract["forbidden_modules"]
    }
    assert handed_on
    assert {
        module: both for module in contract["source_modules"] if (both := handed_on & {*imports_from(module)})
    } == {}


def test_the_core_can_be_read_by_one_person() -> None:
    lines = 0
    for module in core_contract()["source_modules"]:
        path = ROOT / module.replace(".", "/")
        text = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text(encoding="utf-8")
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        spans = [range(t.start[0], t.end[0] + 1) for t in tokens if t.type not in BLANK]
        docstrings = (
            range(node.lineno, node.end_lineno + 1)
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        )
        lines += len(set().union(*spans).difference(*docstrings))
    assert lines <= 12_000


def test_an_import_of_a_feature_by_the_core_breaks_its_contract(tmp_path: Path) -> None:
    for package in ("nlp", "topo_search", "verify"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    command = [sys.executable, "-c", "from importlinter.cli import lint_imports_command; lint_imports_command()"]
    with (tmp_path / "nlp" / "ipopt.py").open("a", encoding="utf-8") as core:
        core.write("import nlp.hinge_sets\n")
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1
    assert "nlp.ipopt is not allowed to import nlp.hinge_sets" in done.stdout


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant["file"])
def test_a_mutant_can_be_put_in_and_its_test_exists(mutant: dict[str, str]) -> None:
    assert (ROOT / mutant["file"]).read_text(encoding="utf-8").count(mutant["old"]) == 1
    path, _, name = mutant["test"].partition("::")
    assert not name or f"def {name}(" in (ROOT / path).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["verify", "nlp"])
def test_a_file_of_the_users_in_the_way_of_a_package_is_named(tmp_path, name):
    own = tmp_path / f"{name}.py"
    own.write_text("")
    code = "import topo_search"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.stderr.splitlines()[-1].startswith(f"ImportError: {own} is in the way of"), done.stderr


@pytest.mark.parametrize(
    ("member", "limits", "quota"),
    [
        ("0::/a/b", {"a/cpu.max": "150000 100000", "a/b/cpu.max": "max 100000"}, 1.5),
        ("0::/", {"cpu.max": "50000 100000"}, 0.5),
        ("0::/host/path", {"cpu.max": "200000 100000"}, 2.0),  # which the container's own view lacks
        ("1:cpu:/", {}, math.inf),
        ("0::/", {}, math.inf),
    ],
)
def test_a_container_limits_the_workers(tmp_path, monkeypatch, member, limits, quota):
    files = {"proc/self/cgroup": member, **{f"sys/fs/cgroup/{name}": text for name, text in limits.items()}}
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(f"{text}\n")
    assert binding.cpu_quota(tmp_path) == quota
    monkeypatch.setattr(binding, "cpu_quota", lambda root: quota)
    monkeypatch.setattr("os.sched_getaffinity", lambda _: range(64))
    assert binding.available_cores() == (64 if math.isinf(quota) else math.ceil(quota))
