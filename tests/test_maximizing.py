"""The search for the most capable platform: its solver, its order, its answer."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from capability_cases import drawn, held, platform_at
from commands import invoke
from scipy.optimize import minimize

from nlp.assembled.problem import AssembledProblem
from nlp.climbing import RaisedProblem
from nlp.lazy_solve import without_corners
from nlp.program import AssembledProgram
from nlp.starts.random_starts import draw, generator
from topo_search import plot_front, prove, read_task, search
from topo_search.cli.tables import result_lines
from topo_search.compose import check_proofs
from topo_search.compose.maximizing import MostCapable
from topo_search.engine import Candidates, Job, Proposal
from topo_search.engine.randomized import FEWEST_OPEN, RandomizedSearch
from topo_search.engine.strategy import WAIT, Tried
from topo_search.export.allocation import allocation
from topo_search.model import BadInput, Design, Status, Topology
from topo_search.model.corners import to_corners
from topo_search.model.files import read_json
from topo_search.model.maximized import BALL, growing_cases, measure, ring, task_at, unit_of
from topo_search.model.proven import lower_text
from topo_search.model.vehicle import read_vehicle
from verify import audit, case_reserves
from verify.flight.vehicle import capability

HOVER = (
    'load_cases=[{name="hover",carries_weight=true}]',
    "module.joint_mass=0",
    'end_effector={rod="none",largest_reach=false}',
    "exposure=[]",
    "flight.defaults=false",
)


def hover(n, *settings):
    """A task of n modules that only hover, with a quantity to maximise."""
    return read_task("push", (*HOVER, f"modules={n}", 'search.maximize="force_reserve"', *settings))


@pytest.fixture(scope="module")
def answer(tmp_path_factory):
    """The strongest platform of three modules."""
    return search(hover(3), out=tmp_path_factory.mktemp("strong") / "run", starts=2, workers=1)


def test_what_is_reported_is_what_the_audit_measures(answer):
    design, weight = answer.design, answer.design.task.force_unit(3)
    assert design.value >= 0.3129 * weight
    assert design.task.flight.force_reserve == design.value == answer.best.value
    again = audit(design)
    assert again.verdict.value == "clear"
    assert again.flight.hover.horizontal_reserve_com_N == pytest.approx(design.value, rel=1e-9)
    assert measure(design.task, case_reserves(design))[0] == pytest.approx(design.value, rel=1e-9)


def test_its_exported_rotors_are_as_capable(answer, tmp_path):
    design = answer.design
    (tmp_path / "rotors.csv").write_text(allocation(design).rotor_csv())
    (tmp_path / "vehicle.toml").write_text(f'mass = {design.task.total_mass(3)!r}\nrotors = "rotors.csv"\n')
    found = capability(read_vehicle(tmp_path / "vehicle.toml"))
    assert found.flight.hover.horizontal_reserve_com_N == pytest.approx(design.value, rel=1e-9)


def hovering(task, rng):
    """A random tree and angles that hover."""
    while True:
        tree, theta, tip = drawn(task, rng)
        if held(task, platform_at(task, tree, theta, tip)) is not None:
            return tree, theta


@pytest.mark.slow
@pytest.mark.parametrize(("quantity", "n"), [("force_reserve", 3), ("torque_reserve", 2)])
def test_no_descent_of_random_platforms_holds_more(tmp_path, quantity, n):
    """Hinges and root of many trees are moved to hold more, judged by own linear programs."""
    task = hover(n, f'search.maximize="{quantity}"')
    answer, rng = search(task, out=tmp_path / "run", workers=1), np.random.default_rng(n)
    resolved, tip, towards, best = task.resolve(n), np.zeros(3), ring(16) if n == 3 else BALL, 0.0
    for _ in range(6):
        tree, theta = hovering(resolved, rng)

        def lost(theta, tree=tree):
            return -(held(resolved, platform_at(resolved, tree, theta, tip), towards) or 0.0)

        simplex = theta + np.vstack([np.zeros(n + 2), 0.3 * np.eye(n + 2)])
        options = {"maxfev": 300, "initial_simplex": simplex}
        best = max(best, -minimize(lost, theta, method="Nelder-Mead", options=options).fun)
    most = 1 / math.cos(math.pi / 16) if n == 3 else 1.08  # of directions that are as far apart as these
    assert 0.8 * answer.best.value < best < most * answer.best.value


def test_the_front_of_a_value_is_against_goals_and_effort(tmp_path):
    task = hover(3, "goals.peak_input=[1.0,0.5]")
    answer = search(task, out=tmp_path / "run", topologies=["a300"], starts=1, workers=1)
    points, frame = answer.points, answer.front
    values = [point.row.value for point in points]
    assert len(points) > 1
    assert values == sorted(values, reverse=True) == frame["value"].tolist()
    assert frame["objective"].is_monotonic_decreasing
    assert answer.best.value == answer.design.value == values[0]
    for goal, title in (
        ("peak_input", "largest rotor input over u_max"),
        ("objective", "control effort J [rad⁴/s⁴]"),
    ):
        layout = plot_front(answer, goal).layout
        assert layout.yaxis.title.text == "largest force reserve [N]"
        assert layout.xaxis.title.text == title
    printed = "\n".join(result_lines(answer))  # a title may take two lines
    assert re.search(r"largest force\b.*\breserve \[N\]", printed, re.DOTALL)
    assert all(lower_text(value, 4) in printed for value in values)


def test_the_answer_speaks_of_the_value(answer):
    best, size = answer.best, answer.sizes[0]
    assert [row.value for row in size.top] == sorted((row.value for row in size.top), reverse=True)
    assert best.value_bound > best.value
    assert best.gap == pytest.approx(best.value_bound / best.value - 1)
    assert best.lower_bound is None
    assert size.objective.words(best).startswith("force reserve 2.4")
    assert "force reserve" in str(answer)
    assert answer.candidates.loc[0, "value"] == best.value
    told = json.loads(invoke("show", answer.folder, "--json").stdout)
    assert told["best"]["value"] == best.value
    assert told["sizes"][0]["objective"] == "largest force reserve"


def test_a_run_is_proven_and_its_proof_is_checked(answer):
    best = answer.best
    size = prove(answer.folder, gap=0.45, workers=1).sizes[0]
    assert size.proven.startswith("proven by branch and bound: no 3-module topology has more than")
    assert size.best.value == best.value
    assert size.candidates_gap <= 0.45 < best.gap
    checked = check_proofs(answer.folder, workers=1)
    assert checked.settled
    assert {tree.verdict for tree in checked.trees} == {"checked"}
    assert all(tree.bound <= 1.45 * best.value * (1 + 1e-6) for tree in checked.trees)


def test_random_platforms_hold_less(answer):
    """Random hinges and roots, each judged by linear programs of the audit."""
    rng, design = np.random.default_rng(0), answer.design
    for _ in range(40):
        angles = tuple(rng.uniform(-1.2, 1.2, 2).tolist())
        root = tuple(rng.uniform(-np.pi, np.pi, 3).tolist())
        other = design.model_copy(update={"hinge_angles_rad": angles, "root_orientation_rad": root})
        reserves = case_reserves(other)
        if reserves[0].possible:
            assert measure(other.task, reserves)[0] <= design.value


@pytest.mark.parametrize("raises", [True, False])
def test_derivatives_of_the_raised_program(raises):
    task = hover(2, 'flight.at="both"').resolve(2)
    once, twice = (to_corners(task_at(task, k * unit_of(task))) for k in (1, 2))
    few = range(0, len(once.corners), 40)
    once, twice = once.with_corners(few), twice.with_corners(few)
    tree = Topology.from_key("a10")
    start = draw(without_corners(once), tree, rng=generator(without_corners(once), tree, 0, 0))
    u = np.full((len(once.load_cases), *start.u.shape[1:]), start.u.mean())
    program = AssembledProblem(once, tree, [], 30.0)
    raised = RaisedProblem(program, once, twice, raises=raises)
    x = np.append(replace(start, task=once, u=u).pack(), 0.3)
    rng, mu, h = np.random.default_rng(1), np.random.default_rng(2).normal(size=raised.rows), 1e-6

    def jacobian(v):
        full = np.zeros((raised.rows, raised.size))
        rows, columns = raised.jacobian_pattern.get_triplet()
        full[rows, columns] = raised.jacobian(v)
        return full

    def hessian(v):
        full = np.zeros((raised.size, raised.size))
        rows, columns = raised.hessian_pattern.get_triplet()
        full[rows, columns] = raised.hessian(v, 1.0, mu)
        return full + np.triu(full, 1).T

    for _ in range(3):
        d = rng.normal(size=raised.size)
        moved = [x + h * d, x - h * d]
        values = [raised.constraints(v) for v in moved]
        slopes = [raised.gradient(v) + mu @ jacobian(v) for v in moved]
        change = (raised.objective(moved[0]) - raised.objective(moved[1])) / (2 * h)
        assert raised.gradient(x) @ d == pytest.approx(change, abs=1e-6)
        np.testing.assert_allclose(jacobian(x) @ d, (values[0] - values[1]) / (2 * h), atol=1e-7)
        np.testing.assert_allclose(hessian(x) @ d, (slopes[0] - slopes[1]) / (2 * h), atol=1e-6)
    directly = AssembledProblem(twice, tree, [], 30.0).constraints(x[:-1])
    np.testing.assert_allclose(raised.constraints(np.append(x[:-1], 2.0)), directly, atol=1e-12)


def test_a_hinge_beyond_its_limits_is_polished_from_the_nearest_one():
    """A climb may start where the rows of hinges are not yet met."""
    task, tree = hover(2).resolve(2), Topology.from_key("a10")
    start = draw(task, tree, rng=generator(task, tree, 0, 0))
    for alpha in (-2.0, 0.1, 2.0):
        _, lower, upper = AssembledProgram(task, tree, ()).assemble(replace(start, alpha=np.array([alpha])), 0.01)
        assert np.all(lower <= upper)
        assert upper[3] - lower[3] == pytest.approx(0.02 if alpha == 0.1 else 0.01)


def proposals(values, *, late):
    """Keys and values to exceed of all proposals, whose results come at once or as late as they may."""
    strategy = RandomizedSearch(Candidates(hover(4).resolve(4), "task"), starts=1, seed=0)
    asked, told = list[Proposal](), 0
    while (proposal := strategy.ask()) is not None:
        if isinstance(proposal, Proposal):
            asked.append(proposal)
        while told < len(asked) and (proposal == WAIT or not late):
            key = asked[told].candidate.key
            strategy.tell(Tried(key, 1, "feasible", 1.0, None, values(key)))
            told += 1
            if late:
                break
    return [(proposal.candidate.key, proposal.reach) for proposal in asked]


def test_the_order_of_results_does_not_matter_to_what_is_asked():
    def values(key):
        return float(sum(map(ord, key)) % 17)

    at_once, late = (proposals(values, late=late) for late in (False, True))
    assert at_once == late
    assert len({key for key, _ in late}) == len(late) > FEWEST_OPEN
    for number, (_, reach) in enumerate(late):
        known = late[: max(0, number - max(FEWEST_OPEN, number // 8) + 1)]
        assert reach == max((values(key) for key, _ in known), default=0.0)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (("flight.force_reserve=0.2",), "flight.force_reserve: must be left out if it is maximised, but got 0.2"),
        (('search.maximize="load"',), "search.maximize: needs a load case with a wrench at the end-effector"),
        (("load_cases=[{end_effector={force=[1.0,0.0,0.0]}}]", 'search.maximize="payload"'), "carries the weight"),
        (("goals.force_reserve=[0.1,0.2]",), "goals.force_reserve: must be left out if it is maximised"),
        (('flight.allocator="pseudo-inverse"',), "flight.allocator: must be `optimal` if a reserve is maximised"),
        (('search.maximize="thrust"',), "force_reserve"),
    ],
)
def test_what_cannot_be_maximised_is_refused(settings, words):
    with pytest.raises(BadInput) as refusal:
        hover(2, *settings)
    assert words in str(refusal.value)


@pytest.mark.parametrize("option", [{"keep_within": 1.0}, {"prune": True}])
def test_options_that_compare_efforts_are_refused(tmp_path, option):
    with pytest.raises(ValueError, match="compares efforts"):
        search(hover(2), out=tmp_path / "run", **option)
    assert not (tmp_path / "run").exists()


def test_a_climb_that_ends_below_what_was_asked_is_told_as_it_is(answer, monkeypatch):
    """A solver that sees few directions finds designs for more than they hold."""
    design = answer.design
    job = Job(hover(3).resolve(3), design.topology, range(1), 0, reach=1.2 * design.value)
    monkeypatch.setattr(MostCapable, "_climb", lambda self, found: self._measure(found)[0])
    seen = design.model_copy(update={"task": task_at(design.task, 1.3 * design.value)})
    found = MostCapable(job, lambda _: seen, lambda *_: [], audit).best()
    assert found.value == pytest.approx(design.value, rel=1e-9)


def test_smaller_loads_are_audited_where_air_is_limited():
    """Air too fast at five eighths of the load fails the audit."""
    design = read_json(Design, Path(__file__).parent / "designs/wall-push.json")
    told, speed = [], {"exposure": [e.replace(speed=9.0) for e in design.task.exposure]}
    task = design.task.model_copy(update=speed).with_fields("search", maximize="load")
    found = MostCapable(Job(task, design.topology, range(1), 0), None, None, lambda d: told.append(d) or seen(d))
    count = len(growing_cases(task))
    assert count > 0
    u = design.inputs
    both = np.concatenate([u, 0.5 * u[growing_cases(task)]])
    held = task_at(task, 2.0)

    def seen(d):
        at = d.task.search.reached
        return SimpleNamespace(verdict=Status.VIOLATED if at == 1.25 else Status.CLEAR)

    flat = tuple(map(tuple, both.reshape(len(both), -1).tolist()))
    whole = design.model_copy(update={"task": held, "rotor_speeds_squared": flat})
    assert found._audit(whole).verdict is Status.VIOLATED
    assert [d.task.search.reached for d in told] == [2.0, 0.25, 0.5, 0.75, 1.0, 1.25]
    k = growing_cases(task)[0]
    np.testing.assert_allclose(told[4].inputs[k], 0.5 * (both[k] + both[len(u)]))
    efforts = (told[4].inputs ** 2).sum(axis=(1, 2))
    assert told[4].objective == pytest.approx(efforts @ [case.weight for case in held.load_cases])
    bare = whole.model_copy(update={"task": held.model_copy(update={"exposure": design.task.exposure})})
    told.clear()
    found._audit(bare)
    assert len(told) == 1


def test_only_the_default_of_the_maximised_field_is_dropped():
    task = read_task("push", (*HOVER[:-1], "modules=3", 'search.maximize="force_reserve"'))
    assert task.flight.force_reserve == 0
    assert (task.flight.at, task.flight.directions, task.flight.tilt_deg) == ("com", "horizontal", 10.0)
    assert "flight.force_reserve" not in task.flight.filled
    bare = hover(3)
    assert (bare.flight.at, bare.flight.directions, bare.flight.tilt_deg) == ("com", "horizontal", 0.0)
    stated = hover(3, 'flight.directions="all"', 'flight.at="tip"')
    assert (stated.flight.at, stated.flight.directions) == ("tip", "all")
