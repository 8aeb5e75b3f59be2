"""`topo-search kit`: the choice against all combinations, the shared part against all maps, and two runs."""

import json
import math
import random
import re
import shlex
from collections import Counter
from dataclasses import replace
from itertools import pairwise, permutations, product
from pathlib import Path

import networkx as nx
import numpy as np
import pytest
import toy_problem
from benchmarks import drawer
from commands import invoke
from documented import PAGES, blocks
from nlp_cases import push, solved
from toy_problem import toy_run, toy_task

import verify
from nlp import solve
from topo_search.cli import main
from topo_search.compose import binding, searching
from topo_search.compose.choosing import choose, count_kinds, shared_part
from topo_search.compose.drawer import growing_steps, share_brackets
from topo_search.compose.rounding import move_hinges
from topo_search.compose.shared_kit import SharedKit
from topo_search.engine import Job
from topo_search.export import palette
from topo_search.model import Design, Module, Topology
from topo_search.model.files import read_json
from topo_search.topologies import sample
from verify.kinematics import platform

ANGLES = (-45.0, -30.0, 0.0, 30.0, 30.0004)


def made_up(draw: random.Random, n: int, key: str | None = None) -> Design:
    """Return a design of a tree with angles and an effort that are drawn."""
    keys = {3: ["a300", "a500", "a110", "p190"], 4: ["a7000", "a1110"], 5: ["a70010", "ab0040"]}
    tree = Topology.from_key(key or draw.choice(keys[n]))
    design = toy_problem.solve(Job(toy_task(n).resolve(n), tree, starts=range(1), seed=0))
    angles = tuple(math.radians(draw.choice(ANGLES)) for _ in range(n - 1))
    return design.model_copy(update={"hinge_angles_rad": angles, "objective": draw.uniform(1.0, 1.02)})


def brute_part(one: Design, other: Design) -> int:
    """Return the number of joints in the largest piece that two designs of one size share, over all maps."""
    n, most = one.topology.n, 0

    def joints(design):
        turns = np.array([1, -1, -1, 1])
        for (h, i, a, b), alpha in zip(design.topology.edges(), design.hinge_angles_rad, strict=True):
            yield h, a, i, b, round(turns[a] * math.degrees(alpha), 3)

    theirs = {frozenset([(h, a), (i, b)]): angle for h, a, i, b, angle in joints(other)}
    for numbers, turns in product(permutations(range(n)), product((0, 2), repeat=n)):
        kept = nx.Graph()
        for h, a, i, b, angle in joints(one):
            ends = frozenset([(numbers[h], (a + turns[h]) % 4), (numbers[i], (b + turns[i]) % 4)])
            if theirs.get(ends) == angle:
                kept.add_edge(h, i)
        most = max([most, *(len(piece) - 1 for piece in nx.connected_components(kept))])
    return most


def drawer_size(designs) -> int:
    """Return the number of brackets that serve all designs."""
    each = [Counter(round(abs(math.degrees(a)), 3) for a in design.hinge_angles_rad) for design in designs]
    return sum(max(counts[kind] for counts in each) for kind in set().union(*each))


@pytest.mark.parametrize("seed", range(8))
def test_the_choice_is_that_of_all_combinations(seed):
    draw = random.Random(seed)
    sizes = {0: [4, 4], 1: [5, 5]}.get(seed, [3, 3, 3])
    choices = [[made_up(draw, n) for _ in range(draw.randint(1, 4))] for n in sizes]
    least = [min(design.objective for design in each) for each in choices]
    stay = [[[brute_part(a, b) for b in other] for a in one] for one, other in pairwise(choices)]

    def cost(places):
        designs = [each[d] for each, d in zip(choices, places, strict=True)]
        moves = -sum(table[d][e] for table, (d, e) in zip(stay, pairwise(places), strict=True))
        effort = sum(design.objective / J for design, J in zip(designs, least, strict=True))
        return drawer_size(designs), moves, effort

    assert choose(choices) == min(product(*(range(len(each)) for each in choices)), key=cost)


@pytest.mark.parametrize(("n", "tasks", "count", "step"), [(3, 4, 6, 45.0), (4, 3, 12, 30.0), (5, 3, 16, 15.0)])
def test_many_designs_some_of_them_copies_are_chosen_from_exactly(n, tasks, count, step):
    choices = drawer.synthetic_choices(n, tasks, count, step)
    copied = [each[k] for k in (1, 2) for each in choices[:1]]
    choices[-1] += [design.model_copy(update={"objective": 1.03}) for design in copied]
    stay = [[[len(shared_part(a, b)) for b in other] for a in one] for one, other in pairwise(choices)]
    kinds = [[count_kinds(design) for design in each] for each in choices]

    def cost(places):
        counts = [each[d] for each, d in zip(kinds, places, strict=True)]
        brackets = sum(max(count[kind] for count in counts) for kind in set().union(*counts))
        moves = -sum(table[d][e] for table, (d, e) in zip(stay, pairwise(places), strict=True))
        effort = sum(each[d].objective / each[0].objective for each, d in zip(choices, places, strict=True))
        return brackets, moves, round(effort, 9)

    assert cost(choose(choices)) == min(map(cost, product(*(range(len(each)) for each in choices))))


def test_one_task_and_one_module_have_a_choice_too():
    draw = random.Random(0)
    alone = [made_up(draw, 1, "a0") for _ in range(3)]
    assert choose([alone]) == (min(range(3), key=lambda d: alone[d].objective),)


@pytest.mark.parametrize("seed", range(10))
def test_a_shared_part_is_congruent_and_the_largest(seed):
    draw = random.Random(seed)
    n = 4
    keys = [topology.key for topology in sample(n, 2, seed=seed, connectors="any")]
    one, other = (made_up(draw, n, key) for key in keys)
    part = shared_part(one, other)
    assert len(part) - 1 == brute_part(one, other)
    same_place(one, other, part)


def same_place(one: Design, other: Design, part: dict[int, int]) -> None:
    """Hold the modules of a part against each other: where each sees the others, up to half a turn of its own."""
    at, there = platform(one), platform(other)
    for (i, j), (k, m) in product(part.items(), repeat=2):
        mine, theirs = (p.R[u].T @ (p.p[v] - p.p[u]) for p, u, v in ((at, i, k), (there, j, m)))
        assert min(np.abs(theirs - mine * [s, s, 1]).max() for s in (1, -1)) < 1e-5
        assert at.z[i] @ at.z[k] == pytest.approx(there.z[j] @ there.z[m], abs=1e-5)


def test_a_platform_counted_from_another_root_shares_everything():
    draw = random.Random(3)
    one = made_up(draw, 3, "a120")  # a straight chain
    first, second = one.hinge_angles_rad
    middle = toy_problem.solve(
        Job(one.task, Topology(((-1, -1, -1), (0, 0, 2), (0, 2, 0))), starts=range(1), seed=0)
    )
    other = middle.model_copy(update={"hinge_angles_rad": (second, -first)})
    part = shared_part(one, other)
    assert part == {0: 2, 1: 0, 2: 1}
    same_place(one, other, part)
    assert count_kinds(one) == count_kinds(other)


def bent(angles: dict[str, tuple[float, float]]):
    """Return a solver whose trees have these angles [deg]."""

    def solve(job):
        design = toy_problem.solve(job)
        given = angles.get(job.topology.key, angles.get("*", (11.0, 12.0)))
        return design.model_copy(update={"hinge_angles_rad": tuple(map(math.radians, given))})

    return replace(toy_problem.BACKENDS, solve=solve)


def run(path, angles, **fields) -> Design:
    task = toy_task().model_copy(update=fields)
    toy_run(path, task=task, backends=bent(angles))
    return read_json(Design, path / "best.json")


def test_two_runs_end_in_a_drawer_a_change_and_two_kits(tmp_path):
    angles = {"a300": (30.0, -30.0), "a500": (20.0, 30.0), "a110": (30.0, 45.0)}
    run(tmp_path / "one", angles, name="push")
    run(tmp_path / "two", {key: pair[::-1] for key, pair in angles.items()}, name="wall")
    done = invoke("kit", tmp_path / "one", tmp_path / "two", "--within", 100, "--out", tmp_path / "kit", "--json")
    told = json.loads(done.stdout)
    assert told == json.loads((tmp_path / "kit/kit.json").read_text())
    designs = [read_json(Design, tmp_path / "kit" / task["design"]) for task in told["tasks"]]
    assert [task["task"] for task in told["tasks"]] == ["push", "wall"]
    assert sum(kind["count"] for kind in told["brackets"]) == drawer_size(designs) == 2
    (change,) = told["changes"]
    undo = 2 - brute_part(*designs)
    assert {name: change[name] for name in ("from", "to", "undo", "bolt")} == {
        "from": "push", "to": "wall", "undo": undo, "bolt": undo,
    }  # fmt: skip
    check_steps(change, *designs)
    printed = {path.name for path in (tmp_path / "kit/brackets").iterdir()}
    assert printed == {f"bracket_{kind['angle_deg']:.3f}deg.stl" for kind in told["brackets"]}
    for task in told["tasks"]:  # the drawer holds what the kit of each task prints
        folder = (tmp_path / "kit" / task["design"]).parent / "brackets"
        assert all((tmp_path / "kit/brackets" / path.name).read_bytes() == path.read_bytes()
                   for path in folder.glob("bracket_*"))  # fmt: skip
    page = (tmp_path / "kit/index.html").read_text()
    sheet = (tmp_path / "kit/change-1-push-wall.html").read_text()
    assert page.count("<svg") == 4
    for each in (page, sheet):
        assert "in the last step of the assembly sheet of wall" in " ".join(each.split())
    assert sheet.count(palette.END_EFFECTOR) == 2 * (2 - undo)
    for task, design in zip(told["tasks"], designs, strict=True):
        best = read_json(Design, tmp_path / ("one" if task["task"] == "push" else "two") / "best.json")
        assert task["over_best_percent"] == pytest.approx(100 * (design.objective / best.objective - 1))
    sheets = [(tmp_path / "kit" / task["design"]).with_name("assembly.html").read_text() for task in told["tasks"]]
    assert [f"from push to wall: undo {undo} joint" in sheet for sheet in sheets] == [False, True]
    assert "new or empty" in invoke("kit", tmp_path / "one", "--out", tmp_path / "kit", status=2).output


def check_steps(change: dict, before: Design, after: Design) -> None:
    """Follow the steps of a change, joint by joint: no step leaves two pieces, and the last makes the design."""
    assert (len(change["undo_steps"]), len(change["bolt_steps"])) == (change["undo"], change["bolt"])
    platform = before.topology.graph()
    for step in change["undo_steps"]:
        assert platform.edges[step["module"], step["to"]]["ports"] == {
            step["module"]: step["port"], step["to"]: step["to_port"],
        }  # fmt: skip
        platform.remove_node(step["module"])
        assert nx.is_connected(platform)
    assert set(platform) == {i for i, _ in change["stay"]}
    platform = after.topology.graph().subgraph([j for _, j in change["stay"]]).copy()
    for step in change["bolt_steps"]:
        ports = {step["module"]: step["port"], step["to"]: step["to_port"]}
        platform.add_edge(step["module"], step["to"], ports=ports)
        assert nx.is_connected(platform)
    assert nx.utils.edges_equal(platform.edges(data=True), after.topology.graph().edges(data=True))


@pytest.mark.parametrize("seed", range(6))
def test_a_change_is_made_step_by_step_in_one_piece(seed):
    draw = random.Random(seed)
    one, other = made_up(draw, 4), made_up(draw, 4)
    part = shared_part(one, other)
    steps = {"undo_steps": growing_steps(one, part)[::-1], "bolt_steps": growing_steps(other, part.values())}
    change = {name: [step.model_dump() for step in each] for name, each in steps.items()}
    check_steps({**change, "undo": 4 - len(part), "bolt": 4 - len(part), "stay": [*part.items()]}, one, other)


def test_local_optima_that_a_run_kept_are_choices(tmp_path):
    """The best designs share no bracket; an optimum 1 % worse does, and is found where it was kept."""

    def optima(job, max_effort):
        if job.task.name == "push":
            return list(job.near)
        other = job.near[0].model_copy(update={"hinge_angles_rad": (math.radians(20.0),) * 2})
        return [*job.near, scaled(other, 1.01)]

    def scaled(design, factor):
        inputs = tuple(tuple(u * math.sqrt(factor) for u in each) for each in design.rotor_speeds_squared)
        return design.model_copy(update={"objective": factor * design.objective, "rotor_speeds_squared": inputs})

    for name, angle in (("push", 20.0), ("wall", 50.0)):
        backends = replace(bent({"*": (angle, angle)}), local_optima=optima)
        toy_run(
            tmp_path / name, task=toy_task().model_copy(update={"name": name}), backends=backends, keep_within=2.0
        )
    done = invoke("kit", tmp_path / "push", tmp_path / "wall", "--out", tmp_path / "kit", "--json")
    told = json.loads(done.stdout)
    assert [(kind["angle_deg"], kind["count"]) for kind in told["brackets"]] == [(20.0, 2)]
    assert told["tasks"][1]["over_best_percent"] == pytest.approx(1.0)


def test_a_shared_bracket_needs_a_clear_design():
    """Angles within the tolerance become one, where the design with it is clear and within the effort."""
    tree = Topology.from_key("a300")
    design = solved(solve(push(3), tree, starts=range(2), seed=0))
    turned = [math.degrees(abs(alpha)) for alpha in design.hinge_angles_rad]
    other, _ = move_hinges(design, hinge_angles_deg=tuple(size + 0.2 for size in turned))
    choices = [[design], [other]]
    assert choose(choices) == (0, 0)
    near = share_brackets(choices, 0.3, 10.0)
    chosen = [designs[d] for designs, d in zip(near, choose(near), strict=True)]
    assert all(verify.audit(one).verdict == "clear" for one in chosen)
    assert drawer_size(chosen) < drawer_size([design, other])
    assert share_brackets(choices, 0.1, 10.0) == choices  # nothing agrees so well
    for each, before in zip(share_brackets(choices, 0.3, 0.0), choices, strict=True):
        assert max(one.objective for one in each) <= before[0].objective


def test_a_tolerance_as_large_as_the_step_of_a_task_is_refused(tmp_path):
    set_of = toy_task().search.model_copy(update={"hinge_step_deg": 5.0})
    toy_run(tmp_path / "on-steps", task=toy_task().model_copy(update={"search": set_of}))
    words = ("--bracket-tolerance", 6, "--out", tmp_path / "kit")
    told = invoke("kit", tmp_path / "on-steps", *words, status=2).stderr
    assert "--bracket-tolerance: must be below 5, by which hinge angles of" in " ".join(told.split())
    assert not (tmp_path / "kit").exists()


def test_the_commands_of_the_tutorial_make_what_it_shows(tmp_path, monkeypatch):
    """In cheap form: three modules, and designs that are made up."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(binding, "backends", lambda _: bent({"*": (30.0, -45.0)}))
    monkeypatch.setattr(binding, "open_engine", lambda *_: toy_problem.InProcess(1))
    monkeypatch.setattr(searching, "write_page", lambda _: None)
    commands = [shlex.split(block.replace("\\\n", " ")) for block in blocks("sh", "tutorials/one-drawer.md")]
    assert [words[:2] for words in commands] == [["topo-search", "kit"]] * 2
    for words in commands:
        main.commands["kit"].make_context("kit", words[2:])  # all options are known
    cheap = [*commands[0][1:], "--modules", "3"]
    done = invoke(*cheap)
    assert "3 modules and 2 brackets of 2 kinds do all tasks within 0 % of their least effort" in done.stdout
    names = re.findall(r"`(drawer/[^`]+)`", (PAGES / "tutorials/one-drawer.md").read_text())
    assert len(names) == 3
    assert all((tmp_path / name).exists() for name in names)
    assert len(list((tmp_path / "runs").glob("*/optima.json"))) == 3
    (tmp_path / "drawer").rename(tmp_path / "before")
    monkeypatch.setenv("TOY_LOG", str(tmp_path / "log"))
    invoke(*cheap)
    assert not (tmp_path / "log").exists()  # nothing was solved again
    assert (tmp_path / "drawer/kit.json").read_bytes() == (tmp_path / "before/kit.json").read_bytes()


def check_drawer(folder: Path) -> SharedKit:
    """Hold a drawer of the tutorial against its designs: each is clear and on the set, and the steps lead there."""
    shared = read_json(SharedKit, folder / "kit.json")
    designs = [read_json(Design, folder / task.design) for task in shared.tasks]
    for task, design in zip(shared.tasks, designs, strict=True):
        assert task.task == design.task.name
        assert set(design.hinge_angles_rad) <= {math.radians(5 * k) for k in range(-18, 19)}
        assert verify.audit(design).verdict == "clear"
    assert len({design.task.module.model_dump_json(exclude={"airflow"}) for design in designs}) == 1
    assert sum(kind.count for kind in shared.brackets) == drawer_size(designs)
    for change, (before, after) in zip(shared.changes, pairwise(designs), strict=True):
        assert change.undo == before.topology.n - 1 - brute_part(before, after)
        check_steps(change.model_dump(), before, after)
    return shared


def test_the_kept_drawer_of_the_tutorial_is_what_it_says():
    shared = check_drawer(Path(__file__).parent / "designs/drawer")
    words = " ".join((PAGES / "tutorials/one-drawer.md").read_text().split())
    assert shared.lines[0].removeprefix("3 modules and ") in words
    assert f"{sum(change.undo for change in shared.changes)} joint in all" in words


@pytest.mark.slow
def test_the_tutorial_makes_the_kept_drawer_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = shlex.split(blocks("sh", "tutorials/one-drawer.md")[0].replace("\\\n", " "))
    invoke(*command[1:], "--workers", "1")
    made, kept = (check_drawer(path) for path in (tmp_path / "drawer", Path(__file__).parent / "designs/drawer"))
    assert (made.brackets, made.designs_kept) == (kept.brackets, kept.designs_kept)
    assert [task.topology_key for task in made.tasks] == [task.topology_key for task in kept.tasks]


def test_settings_are_for_tasks_alone(tmp_path):
    run(tmp_path / "one", {})
    done = invoke("kit", tmp_path / "one", "--modules", "3", "--out", tmp_path / "kit", status=2)
    assert "for tasks" in done.stderr


def test_within_nothing_the_best_designs_are_chosen(tmp_path):
    bests = [run(tmp_path / name, {}, name=name) for name in ("push", "wall")]
    words = ("--within", 0, "--bracket-tolerance", 0.5, "--out", tmp_path / "kit")
    done = invoke("kit", tmp_path / "push", tmp_path / "wall", *words)
    kept = [
        read_json(Design, tmp_path / f"kit/{k}-{best.task.name}/design.json") for k, best in enumerate(bests, 1)
    ]
    assert kept == bests
    assert "0 % of their least effort" in done.output


def test_what_has_no_common_kit_says_so(tmp_path, monkeypatch):
    run(tmp_path / "one", {})
    monkeypatch.setenv("TOY_NONE", "*")
    toy_run(tmp_path / "none")
    done = invoke("kit", tmp_path / "one", tmp_path / "none", "--out", tmp_path / "kit", status=3)
    assert f"{tmp_path / 'none'} has no design with a clear audit" in done.stderr
    assert not (tmp_path / "kit").exists()


@pytest.mark.parametrize(
    ("other", "rule"),
    [
        ("nowhere.toml", "no such file"),
        ("folder", "is not a run folder"),
        ("heavy", "module.mass: must be that of"),
    ],
)
def test_what_is_no_run_or_has_other_modules_is_refused(tmp_path, other, rule):
    run(tmp_path / "one", {})
    (tmp_path / "folder").mkdir()
    if other == "heavy":
        run(tmp_path / other, {}, module=Module(mass=0.3))
    assert rule in invoke("kit", tmp_path / "one", tmp_path / other, "--out", tmp_path / "kit", status=2).stderr
    assert not (tmp_path / "kit").exists()


def test_a_run_with_something_left_is_refused(tmp_path):
    run(tmp_path / "one", {})
    toy_run(tmp_path / "left", time_limit=0.0)
    refused = invoke("kit", tmp_path / "left", "--out", tmp_path / "kit", status=2)
    assert "must be a finished run, but it is not" in refused.stderr
