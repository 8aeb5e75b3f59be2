"""Candidates, samplers and designs to start from of a user's own, from outside the package."""

import networkx as nx
import optuna
import pytest
from commands import invoke
from own_code import MINE, Fewest, make_qmc, make_random
from suites import few

from topo_search import BadInput, OwnSampler, Topology, read_task, search, solve, to_json

pytestmark = pytest.mark.usefixtures("in_process")
HOVER = ("load_cases=[{com={force=[0.0,0.0,1.0]}}]", "exposure=[]")


@pytest.fixture(scope="module")
def hover():
    return read_task("push", ("modules=3", *HOVER))


def joined(*edges, kind=nx.MultiDiGraph):
    """A graph of edges (node, node, port, port)."""
    graph = kind()
    for one, other, a, b in edges:
        graph.add_edge(one, other, ports={one: a, other: b})
    return graph


def keys(answer):
    return sorted(answer.candidates["key"])


def test_only_listed_candidates_are_solved_as_they_stand(hover, tmp_path):
    listed = ["a500", Topology.from_key("a300"), Topology.from_key("aa00").graph(), "a140"]  # two are one design
    answer = search(hover, out=tmp_path / "run", topologies=listed, starts=1)
    assert keys(answer) == ["a140", "a300", "a500", "aa00"]
    assert "every listed topology is a candidate" in answer.sizes[0].quotient
    assert search(hover, out=tmp_path / "run", topologies=reversed(listed), starts=1).best == answer.best
    with pytest.raises(BadInput, match="a run with other topologies"):
        search(hover, out=tmp_path / "run", topologies=["a500"], starts=1)
    assert "4 trees listed by the user" in (tmp_path / "run/report.html").read_text()


@pytest.mark.parametrize(
    ("listed", "words"),
    [
        ([], "must list at least one topology, but has none"),
        (["a10"], r"\[0\]: must have 3 modules, as the task asks, but a10 has 2"),
        (["a500", "a500"], r"\[1\]: must be listed once, but a500 is in \[0\] already"),
        (["zz"], r"\[0\]: a topology key starts with `a`, `p` or `f`, but got 'zz'"),
        (["p308"], 'p308 needs search.connectors = "any", but the task has "aligned"'),
        ([7], r"\[0\]: must be a Topology, a key or a networkx graph, but got int"),
        ([nx.cycle_graph(3)], "must be a tree, but got a graph of 3 nodes and 3 edges"),
        (["a" + "1" * 500], "must be a key of at most 200 modules, but got a text of 501 characters"),
        (["a500"] * 10_001, "must list at most 10,000 topologies, but has more"),
        ("a500", 'topologies: must be a list of topologies, but got "a500"'),
        (5, "topologies: must be a list of topologies, but got int"),
        ([nx.MultiGraph([(0, 1), (1, 2)])], "the edge of 0 and 1 must carry `ports = {node: port}`"),
        ([joined((0, 1, 0, 2), (1, 2, 2, 0))], "port 2 of module 1 carries one joint, but joints 1 and 2 use it"),
        ([joined((0, 1, 0, 4))], "the child port must be 0, 1, 2 or 3 in joint 1, but got 4"),
    ],
)
def test_a_wrong_list_is_refused_before_a_folder_is_made(hover, tmp_path, listed, words):
    with pytest.raises(BadInput, match=words):
        search(hover, out=tmp_path / "run", topologies=listed, starts=1)
    assert not (tmp_path / "run").exists()


def test_every_size_of_the_task_needs_a_topology(tmp_path):
    task = read_task("push", ("modules=[2, 3]", *HOVER))
    with pytest.raises(BadInput, match="must list a topology of each size of the task, but none has 2 modules"):
        search(task, out=tmp_path / "run", topologies=["a500"])


@pytest.mark.parametrize("kind", [nx.Graph, nx.DiGraph, nx.MultiGraph, nx.MultiDiGraph])
def test_no_direction_and_no_second_edge_of_a_joint_loses_a_branch(kind):
    """Edges from child to parent, from parent to child, both, and each twice."""
    for key in ("a0", "a71000", "a3200", "p308"):
        joints = [(h, i, a, b) for h, i, a, b in Topology.from_key(key).edges()]
        back = [(i, h, b, a) for h, i, a, b in joints]
        for edges in (joints, back, joints + back, joints[::2] + back[1::2], joints + joints):
            graph = kind()
            graph.add_nodes_from(range(len(key) - 1))
            graph.update(joined(*edges, kind=kind))
            assert Topology.from_graph(graph).key == key
            assert Topology.from_graph(nx.freeze(graph)).key == key


def test_the_first_node_of_a_directed_graph_is_the_root():
    graph = joined(("left", "root", 2, 0), ("right", "root", 3, 1), kind=nx.DiGraph)
    assert Topology.from_graph(graph).key == Topology(((-1, -1, -1), (0, 2, 0), (1, 1, 3))).key


def test_a_file_lists_the_candidates_of_a_run(tmp_path):
    lines = tmp_path / "keys.txt"
    lines.write_text("a500\n\na300\n")
    options = ["--modules", "3", "--set", HOVER[0], "--set", HOVER[1], "--starts", "1", "--workers", "1"]
    done = invoke("run", "push", *options, "--topologies", lines, "--out", tmp_path / "run", "--json")
    assert '"candidates": 2' in done.output


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a500\na10\n", "line 2: must have 3 modules, as the task asks, but a10 has 2"),
        ("a500\n\na500\n", "line 3: must be listed once, but a500 is in line 1 already"),
        ("\n".join(["x"] * 30), "has 10 more faults"),
        ("a" * 5_000_000, "must have at most 4,194,304 bytes, but has 5,000,000"),
    ],
)
def test_a_wrong_file_of_candidates_is_named_with_2(tmp_path, text, words):
    lines = tmp_path / "keys.txt"
    lines.write_text(text)
    assert words in invoke("run", "push", "--modules", "3", "--topologies", lines, status=2).output
    assert "no such file" in invoke("run", "push", "--topologies", tmp_path / "none", status=2).output


def test_a_design_to_start_from_is_one_more_start(hover, tmp_path):
    tree = Topology.from_key("a500")
    known = solve(hover, "a500", starts=2)
    again = solve(hover, tree, starts=1, near=[known.design])
    assert again.design.solver["starts"] == 2
    assert again.design.objective <= known.design.objective * (1 + 1e-6)
    file = tmp_path / "design.json"
    file.write_text(to_json(known.design))
    options = ["--set", HOVER[0], "--set", HOVER[1], "--starts", "1", "--near", str(file)]
    assert '"starts": 2' in invoke("solve", "push", "--topology", "a500", *options, "--json").output


def test_a_design_to_start_from_belongs_to_the_run(hover, tmp_path):
    known = solve(hover, Topology.from_key("a500"), starts=1).design
    given = {"out": tmp_path / "run", "starts": 1, "workers": 1, "topologies": ["a500", "a300"]}
    answer = search(hover, **given, near=[known])
    assert set(answer.candidates["starts"]) == {2}
    assert search(hover, **given, near=[known]).best == answer.best
    with pytest.raises(BadInput, match="a run with other near"):
        search(hover, **given)
    with pytest.raises(BadInput, match=r"near: \[0\]: must be of the type Design, but got str"):
        search(hover, **{**given, "out": tmp_path / "other"}, near=["design.json"])


@pytest.mark.filterwarnings("ignore::optuna.exceptions.ExperimentalWarning")  # what Optuna says of its own
@pytest.mark.parametrize("sampler", few([MINE, Fewest(), make_random, make_qmc, lambda seed: Fewest()], 2))
def test_any_sampler_proposes(hover, tmp_path, monkeypatch, sampler):
    monkeypatch.setattr("topo_search.compose.searching.write_page", lambda folder: None)
    given = {"strategy": "optuna", "trials": 2, "starts": 1, "workers": 1, "sampler": sampler}
    assert len(search(hover, out=tmp_path / "run", **given).candidates) == 2
    if isinstance(sampler, OwnSampler):
        assert len(search(hover, out=tmp_path / "run", **{**given, "trials": 3}).candidates) == 3
        with pytest.raises(BadInput, match="a run with other sampler"):
            search(hover, out=tmp_path / "run", **{**given, "sampler": OwnSampler("random rows", make_random, "2")})
    else:
        with pytest.raises(BadInput, match="has no version, so that it cannot be resumed"):
            search(hover, out=tmp_path / "run", **given)


class OutOfRange(optuna.samplers.RandomSampler):
    def __init__(self, value):
        super().__init__(seed=1)
        self.value = value

    def sample_independent(self, study, trial, param_name, param_distribution):
        return self.value


def fail(*args):
    raise RuntimeError("no idea")


class Wrong:
    def __init__(self, proposed):
        self.proposed = proposed

    def propose(self, candidates, tried, random):
        return self.proposed


@pytest.mark.parametrize(
    ("sampler", "error", "words"),
    [
        (Wrong("a10"), BadInput, "Wrong.propose: must have 3 modules, but a10 has 2"),
        (Wrong("zz"), BadInput, "a topology key starts with"),
        (Wrong(5), BadInput, "must be a Topology, a key or a networkx graph, but got int"),
        (lambda seed: 3, BadInput, "must make an Optuna sampler, or an object with `propose`, but made int"),
        (optuna.samplers.RandomSampler(seed=1), ValueError, "lambda seed: RandomSampler"),
        (5, ValueError, "sampler must be moves, tpe, nsga2, random, or make one for a seed"),
        (lambda seed: OutOfRange(-1), BadInput, r"OutOfRange: port 1 must be one of 0, \.\.\., 3, but got -1"),
    ],
)
def test_a_wrong_sampler_is_named(hover, tmp_path, sampler, error, words):
    with pytest.raises(error, match=words):
        search(hover, out=tmp_path / "run", strategy="optuna", trials=2, starts=1, workers=1, sampler=sampler)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"name": ""}, "name\n.*at least 1 character"),
        ({"version": 1}, "version\n.*valid string"),
    ],
)
def test_a_sampler_without_a_name_or_a_function_is_refused(fields, words):
    with pytest.raises(ValueError, match=words):
        OwnSampler(**{"name": "mine", "make": make_random, **fields})


@pytest.mark.parametrize(
    ("topology", "words"),
    [
        ("zz", "topology: a topology key starts with"),
        (5, "topology: must be a Topology, a key or a networkx graph, but got int"),
        ("a10", r"near: \[0\]: must be of the type Design, but got str"),
    ],
)
def test_a_wrong_tree_or_start_of_a_single_solve_is_named(hover, topology, words):
    with pytest.raises(BadInput, match=words):
        solve(hover, topology, starts=1, near="design.json")


@pytest.mark.parametrize("task", [5, None, {"name": "push"}])
def test_what_is_no_task_is_named(tmp_path, task):
    words = f"task: must be a Task, a file or the name of a shipped example, but got {type(task).__name__}"
    with pytest.raises(BadInput, match=words):
        solve(task, "a500", starts=1)
    with pytest.raises(BadInput, match=words):
        search(task, out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_own_parts_that_do_not_go_together_are_refused(hover, tmp_path):
    with pytest.raises(ValueError, match="exhaustive"):
        search(hover, out=tmp_path / "run", strategy="optuna", topologies=["a500"])
    with pytest.raises(ValueError, match=r"sampler .* requires the strategy `optuna`"):
        search(hover, out=tmp_path / "run", sampler=make_random)


@pytest.mark.parametrize(("make", "error"), [(fail, RuntimeError), (lambda seed: None, BadInput)])
def test_a_factory_that_makes_no_sampler_leaves_no_folder(hover, tmp_path, make, error):
    with pytest.raises(error):
        search(hover, out=tmp_path / "run", strategy="optuna", trials=2, starts=1, workers=1, sampler=make)
    assert not (tmp_path / "run").exists()
