"""Constraints of a user's own, from outside the package."""

import json
import math
import subprocess
import sys
import threading
from functools import partial

import casadi as ca
import own_code
import pytest
from own_code import EQUAL_FOLDS, UPRIGHT, height, lifted, nonsense, sideways, span, spans, words
from processes import ranking

from nlp.starts.random_starts import draw, generator
from nlp.user_constraints import refuse_unusable
from nlp.user_constraints.rows import UserRows
from topo_search import BadInput, OwnConstraint, Topology, audit, read_task, search, solve, to_json, write_report


@pytest.fixture(scope="module")
def task():
    return read_task("push", ("modules=3",))


@pytest.fixture(scope="module")
def hover():
    return read_task("push", ("modules=3", "load_cases=[{com={force=[0.0,0.0,1.0]}}]", "exposure=[]"))


@pytest.fixture(scope="module")
def free(hover):
    return solve(hover, Topology.from_key("a500"), starts=2)


@pytest.mark.usefixtures("in_process")
def test_a_design_meets_what_is_stated_and_its_audit_lists_it_apart(hover, free):
    limit = 0.5 * (0.3 + max_span(free.design))
    solved = solve(hover, Topology.from_key("a500"), starts=2, constraints=[span(limit, version="1")])
    (check,) = solved.audit.stated
    assert solved.found
    assert (check.name, check.version, check.status, check.unit) == ("span", "1", "met", "m")
    assert check.value <= limit + 1e-7
    assert solved.design.objective >= free.design.objective * (1 - 1e-6)
    assert [one.name for one in solved.design.stated] == ["span"]
    assert "span" not in {row.name for row in solved.audit.residuals}
    assert "stated by the user, not certified" in solved.audit._repr_html_()
    (kept,) = json.loads(to_json(solved.design))["stated"]
    assert kept == {
        "name": "span", "version": "1", "lower": None, "upper": limit, "unit": "m", "invariant": "mirror",
    }  # fmt: skip
    unchecked = audit(solved.design)  # without the expression
    assert [(one.status, one.value) for one in unchecked.stated] == [("not checked", None)]
    assert unchecked.verdict == "clear"


def max_span(design):
    (check,) = audit(design, constraints=[OwnConstraint("span", spans, upper=10.0, unit="m")]).stated
    return check.value


def test_a_design_that_misses_what_is_stated_is_not_clear(free):
    audited = audit(free.design, constraints=[span(0.01)])
    (check,) = audited.stated
    assert (check.status, audited.verdict) == ("missed", "violated")
    assert check.off_by == pytest.approx(check.value - 0.01)


@pytest.mark.usefixtures("in_process")
def test_what_nothing_can_meet_is_infeasible_by_its_name(hover):
    solved = solve(hover, Topology.from_key("a500"), starts=1, constraints=[span(0.05)])
    assert not solved.found
    assert solved.outcome.status == "infeasible"  # not proven: nothing about it is
    assert "span" in solved.outcome.message


@pytest.mark.usefixtures("in_process")
def test_large_platforms_keep_what_is_stated_as_well():
    hover = read_task("push", ("modules=8", "load_cases=[{com={force=[0.0,0.0,1.0]}}]", "exposure=[]"))
    solved = solve(hover, Topology.from_key("a74202200"), starts=2, constraints=[UPRIGHT])
    assert solved.found, str(solved)
    (check,) = solved.audit.stated
    assert check.status == "met"
    assert check.value >= 0.99 - 1e-6


@pytest.mark.usefixtures("in_process")
def test_a_run_with_versions_resumes_and_others_are_refused(hover, tmp_path):
    stated, given = [span(0.55, version="1"), EQUAL_FOLDS], {"topologies": ["a500"], "starts": 1}
    first = search(hover, out=tmp_path / "run", constraints=stated, **given)
    again = search(hover, out=tmp_path / "run", constraints=stated, **given)
    assert first.best == again.best
    assert len(first.solves) == len(again.solves)
    assert {one.name for one in first.audit.stated} == {"span", "equal folds"}
    for others in ([], [span(0.55, version="2"), EQUAL_FOLDS], [span(0.54, version="1"), EQUAL_FOLDS]):
        with pytest.raises(BadInput, match="a run with other constraints"):
            search(hover, out=tmp_path / "run", constraints=others, **given)
    page = (tmp_path / "run/report.html").read_text()
    assert "Stated by the user, not certified" in page
    assert "equal folds" in page
    assert write_report(tmp_path / "run").exists()


@pytest.mark.usefixtures("in_process")
def test_a_run_without_versions_is_not_resumed(hover, tmp_path):
    given = {"topologies": ["a500"], "starts": 1}
    answer = search(hover, out=tmp_path / "run", constraints=[span(0.6)], **given)
    assert answer.found
    assert not answer.candidates.empty  # reading it is another matter
    for others in ([span(0.6)], []):
        with pytest.raises(BadInput, match="'span' of your own, which has no version, so"):
            search(hover, out=tmp_path / "run", constraints=others, **given)


def test_a_run_that_was_only_begun_may_have_functions_without_versions(task, tmp_path):
    from topo_search.study import Request, RunFolder, UserInputs

    own = UserInputs(constraints=({"name": "span", "upper": 0.6},))
    for _ in range(2):
        with RunFolder.open(tmp_path / "run", Request(task, "task", 1, 0, user_inputs=own)):
            pass


@pytest.mark.usefixtures("in_process")
def test_a_constraint_that_tells_modules_apart_gets_every_rooted_tree(tmp_path):
    hover = read_task("push", ("modules=2", "load_cases=[{com={force=[0.0,0.0,1.0]}}]", "exposure=[]"))
    plain = search(hover, out=tmp_path / "plain", starts=1)
    told = search(hover, out=tmp_path / "told", starts=1, constraints=[lifted(0, 0.0, version="1")])
    assert (plain.sizes[0].candidates, told.sizes[0].candidates) == (2, 4)  # n F(n) = 2 * 2
    assert "may depend on module numbers" in told.sizes[0].quotient
    # a polish may end up to 0.1 mm above the margin, where the smooth form of a clearance ends: 5e-6 of the effort
    assert told.best.objective == pytest.approx(plain.best.objective, rel=1e-5)


def test_a_constraint_that_tells_mirror_images_apart_keeps_half_turns_alone():
    task = read_task("push", ("modules=4",))
    plain, told = (counted(task, stated) for stated in ([], [("sideways", "numbering")]))
    assert plain == 10
    assert told > plain


def counted(task, stated):
    from topo_search.study import Request, UserInputs

    own = UserInputs(constraints=tuple({"name": name, "upper": 0.0, "invariant": claim} for name, claim in stated))
    return Request(task, "task", 1, 0, user_inputs=own).space(task.n).count()


@pytest.mark.parametrize(
    ("expression", "invariant"), [(partial(height, module=0), "numbering"), (sideways, "mirror")]
)
def test_a_wrong_claim_of_invariance_is_found(task, tmp_path, expression, invariant):
    stated = [OwnConstraint("claim", expression, upper=0.0, invariant=invariant, version="1")]
    with pytest.raises(BadInput, match=f"claim: says that it is invariant to {invariant}, but one platform is"):
        search(task, out=tmp_path / "run", constraints=stated, starts=1)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ([OwnConstraint("far", nonsense, upper=1.0)], "far: cannot be evaluated for a110: IndexError"),
        ([OwnConstraint("text", words, upper=1.0)], "text: must return a casadi.SX, or a list of them"),
        (
            [OwnConstraint("locked", partial(lambda lock, p: p.axes[0][2], threading.Lock()), upper=1.0)],
            "locked: cannot be sent to worker processes",
        ),
        ([UPRIGHT, UPRIGHT], "upright: must be the name of one constraint"),
        ([3], r"\[0\]: must be of the type OwnConstraint, but got int"),
        ([OwnConstraint("c", own_code.no_number, upper=1.0)], "c: cannot be evaluated for a110: must have a"),
        ([OwnConstraint("c", own_code.infinite, lower=1.0)], "must have a finite value"),
        ([OwnConstraint("c", own_code.strange, upper=1.0)], "may use only the platform's symbols, but has"),
    ],
)
def test_what_cannot_be_used_is_refused_before_a_folder_is_made(task, tmp_path, stated, words):
    with pytest.raises(BadInput, match=words):
        search(task, out=tmp_path / "run", constraints=stated, starts=1)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("place", ["prompt", "script"])
def test_a_constraint_that_no_worker_imports_goes_to_it_by_value(tmp_path, place):
    typed = """
LEAST = 0.9
def upright(platform):
    return platform.axes[0][2] - LEAST
task = read_task("push", ("modules=2", "load_cases=[{com={force=[0.0,0.0,1.0]}}]"))
stated = [OwnConstraint("typed", upright, lower=0.0), OwnConstraint("lambda", lambda p: p.axes[0][2], upper=2.0)]
solved = solve(task, "a10", starts=4, constraints=stated)
print(*(one.status for one in solved.audit.stated) if solved.audit else solved)
"""
    text = f"from topo_search import OwnConstraint, read_task, solve\n{typed}"
    script = tmp_path / "script.py"
    script.write_text(text)
    source = "-" if place == "prompt" else script
    done = subprocess.run(
        [sys.executable, source], input=text, capture_output=True, text=True, timeout=300, check=False
    )
    assert (done.stdout.strip(), done.returncode) == ("met met", 0), done.stderr


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({}, "lower or upper must be a number"),
        ({"lower": 2.0, "upper": 1.0}, "`lower <= upper` must hold, but got lower=2.0, upper=1.0"),
        ({"upper": 1.0, "scale": 0.0}, "`0 < scale < inf` must hold, but got 0.0"),
        ({"upper": 1.0, "name": ""}, "name\n.*at least 1 character"),
        ({"upper": 1.0, "invariant": "all"}, "invariant\n.*'none', 'numbering' or 'mirror'"),
    ],
)
def test_a_constraint_that_bounds_nothing_is_refused(fields, words):
    with pytest.raises(ValueError, match=words):
        OwnConstraint(**{"name": "one", "expression": spans, **fields})


@pytest.mark.parametrize("expression", [own_code.no_number, own_code.infinite])
def test_what_has_no_number_is_missed(task, expression):
    topology, stated = Topology.from_key("a500"), OwnConstraint("c", expression, lower=-1.0, upper=2.0, unit="m")
    resolved = task.resolve(3)
    rows = UserRows([stated], resolved, topology)
    point = draw(resolved, topology, generator(resolved, topology, 0, 0))
    (missed,) = rows.violations(point)
    assert not missed.met
    assert (missed.name, missed.rank) == ("c (no finite value)", math.inf)
    assert 0 < missed.amount < math.inf  # as a file can hold it


@pytest.mark.parametrize("key", ["a500", "a70010", "aa1106020"])
@pytest.mark.parametrize(
    "expression",
    [
        lambda platform: ca.log(ca.norm_2(platform.end_effector) - 0.6),
        lambda platform: ca.log(0.2 - ca.norm_2(platform.end_effector - platform.centres[0])),
        lambda platform: ca.sqrt(0.04 - platform.hinge_angles**2),
    ],
)
def test_what_has_numbers_for_few_platforms_is_no_mistake(key, expression):
    tree = Topology.from_key(key)
    refuse_unusable([OwnConstraint("c", expression, lower=0.0)], read_task("push").resolve(tree.n), tree)


@pytest.mark.usefixtures("in_process")
def test_a_dask_cluster_solves_what_is_stated_in_a_module_that_it_has_or_by_value(cluster, hover, tmp_path):
    by_value = OwnConstraint("lambda", lambda platform: platform.axes[0][2], upper=2.0, version="1")
    stated = [span(0.55, version="1"), by_value]
    options = {"constraints": stated, "starts": 1, "topologies": ["a500", "a300"]}
    here = search(hover, out=tmp_path / "here", **options)
    there = search(hover, out=tmp_path / "there", dask=cluster.address, **options)
    assert ranking(tmp_path / "here") == ranking(tmp_path / "there")
    assert here.design.model_copy(update={"solver": None}) == there.design.model_copy(update={"solver": None})
    assert there.audit.stated == here.audit.stated
