"""The page as text: what it says, that it holds all it needs, and that no text of a user's ends up as markup."""

import itertools
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from report_cases import Reader, design, toy_page
from suites import few
from toy_problem import BOUND, infeasible, lower_bound, solve, toy_run, toy_task, value

import nlp
from topo_search.compose import audit, read_design, write_report
from topo_search.compose.designs import write_page
from topo_search.engine import Job
from topo_search.limits import quantity
from topo_search.model import BadInput, Design, Infeasible, Status, Topology
from topo_search.model.files import read_json
from topo_search.model.objective import LEAST_EFFORT
from topo_search.model.proven import gap_percent
from topo_search.model.task_file import read_task
from topo_search.model.topology import PORT_NAMES
from topo_search.report.charts import clearance_matrices
from topo_search.report.design_page import design_page
from topo_search.report.page import render
from topo_search.report.run_page import run_page, write_run_page
from topo_search.report.scene import scene
from topo_search.study import Request, RunFolder
from topo_search.study.answer import SHOWN
from topo_search.study.ledger import Row, row_of
from topo_search.topologies import Candidate, candidates
from verify.kinematics import platform


@pytest.fixture(scope="module")
def audited():
    made = design(Topology.from_key("af0000"), "push-two-paths")
    return made, audit(made)


def test_the_page_of_a_run_says_what_the_run_found(tmp_path):
    page = Reader(toy_page(tmp_path / "run", modules=(2, 3), starts=4, seed=5))
    (best,) = re.findall(r"With 2 modules, the smallest requested size, (\w+) is the best found", page.text)
    rows = json.loads(page.data["ranking-data"])["rows"]
    assert rows[0][0] == best
    assert {row[1] for row in rows} == {2, 3}
    assert "audit: clear" in page.text
    assert "topo-search run task.toml --strategy exhaustive --symmetry c2 --starts 4 --seed 5" in page.text
    assert 'name = "toy"' in page.text
    assert json.loads(page.data["view-data"])["parts"]
    for part in ("inputs", "progress-2", "progress-3"):
        assert json.loads(page.data[f"{part}-data"])["data"]


def test_only_several_audited_designs_have_a_plot_to_choose_from(tmp_path):
    one = Reader(toy_page(tmp_path / "one", modules=2, listed=("a20",)))
    several = Reader(toy_page(tmp_path / "several", modules=2))
    assert "choice-data" not in one.data
    assert "choice-data" in several.data


def test_a_run_without_a_design_says_why(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    page = Reader(toy_page(tmp_path / "run"))
    assert "toy: no design with 3 modules" in page.text
    assert "No design was found for toy. 3 modules: no start of" in page.text
    with RunFolder.load(tmp_path / "run") as folder:
        closest = min(folder.ledger.ranking(3), key=lambda row: row.violation)
        reason = folder.ledger.result(folder.request.contexts(3)[0], closest.key)
    assert reason.message in page.text
    assert f"The nearest miss: {closest.key}, 3 modules" in page.text
    assert json.loads(page.data["view-data"])["parts"]
    assert (
        page.text.index("What would help") < page.text.index("The nearest miss") < page.text.index("What was tried")
    )
    (words,) = json.loads(page.data["progress-3-data"])["layout"]["annotations"]
    assert words["text"] == "no solve has found a design"
    statuses = {row[6] for row in json.loads(page.data["ranking-data"])["rows"]}
    assert statuses == {"infeasible"}
    assert (tmp_path / "run" / "closest.json").exists()
    monkeypatch.delenv("TOY_NONE")
    assert "The nearest miss" not in Reader(toy_page(tmp_path / "run", starts=4)).text
    assert not (tmp_path / "run" / "closest.json").exists()


@pytest.mark.parametrize(
    ("sizes", "title"),
    [((2, 3), "toy: no design with 2 or 3 modules"), ((1, 3), "toy: no design with 1 to 3 modules")],
)
def test_the_title_without_a_design_names_the_sizes(tmp_path, monkeypatch, sizes, title):
    monkeypatch.setenv("TOY_NONE", "*")
    text = Reader(toy_page(tmp_path / "run", modules=sizes)).text
    assert title in text
    assert all(f"{quantity(n, 'module')}: no start of" in text for n in range(sizes[0], sizes[1] + 1))
    assert "no design yet with" in Reader(toy_page(tmp_path / "stopped", modules=sizes, time_limit=1e-9)).text


@pytest.mark.parametrize(
    ("variable", "options", "said"),
    [
        (("TOY_VIOLATED", "*"), {}, ["No design found for toy passed its audit"]),
        (("TOY_IMPOSSIBLE", "3"), {}, ["three modules cannot lift what is asked", "impossible"]),
        (("TOY_NONE", ""), {"time_limit": 1e-9}, ["nothing is known yet", "the search was stopped"]),
    ],
)
def test_a_run_without_an_answer_says_so(tmp_path, monkeypatch, variable, options, said):
    monkeypatch.setenv(*variable)
    text = Reader(toy_page(tmp_path / "run", **options)).text
    assert [words for words in said if words not in text] == []


def test_the_page_of_a_design_has_its_clearances_and_no_ranking(audited):
    made, verdict = audited
    page = Reader(render(design_page(made, verdict, "mine.json")))
    assert f"audit: {verdict.verdict}" in page.text
    assert verdict.verdict == Status.VIOLATED
    assert "Proven gap" not in page.text
    assert "The gap is" not in page.text
    assert "topo-search audit mine.json" in page.text
    assert "ranking-data" not in page.data
    cells = [json.loads(page.data[name]) for name in page.data if name.startswith("clearances-")]
    assert len(cells) == 5
    hover = [text for matrix in cells for row in matrix["data"][0]["customdata"] for text in row]
    described = {text.split("<br>")[0] for text in hover if text}
    # of the parts of a module beside another one's airflow the cell has the nearest
    cell = {(p.kind, p.a, p.b, p.kind != "rotor-airflow" and p.segment) for p in verdict.pairs}
    assert len(described) == len(cell)


def test_what_is_odd_about_the_task_is_on_the_page(audited, tmp_path):
    """`check` warns about two load cases of push, which do not carry the weight; the toy task is plain."""
    assert Reader(render(design_page(*audited, "mine.json"))).text.count("Warning: load_cases[") == 2
    assert "Warning:" not in Reader(toy_page(tmp_path / "plain")).text
    toy_run(tmp_path / "run", task=read_task("push", ("gravity=1.62", "modules=3")))
    with RunFolder.load(tmp_path / "run") as folder:
        text = Reader(render(run_page(folder))).text
    assert "Warning: gravity: 1.62 m/s^2 is not that of the Earth's surface." in text


def test_a_page_needs_nothing_but_itself(audited):
    text = render(design_page(*audited, "mine.json"))
    page = Reader(text)
    assert all(link.startswith("#") for link in page.links)
    assert {link[1:] for link in page.links} <= {*page.ids}
    assert len(page.ids) == len({*page.ids})
    assert "default-src 'none'" in text
    assert len(text.encode()) < 6e6


@pytest.mark.parametrize(
    "nasty", few(["</script><script>alert(1)</script>", "a&b\"'\u2028", "<img src=x onerror=alert(1)>"], 2)
)
def test_texts_of_others_stay_text(audited, nasty):
    made, verdict = audited
    pairs = verdict.model_copy(update={"versions": {nasty: nasty}})
    foreign = made.model_copy(update={"solver": {"versions": {nasty: nasty}, "seed": 1, "starts": 2}})
    text = render(design_page(foreign, pairs, nasty))
    assert "<script>alert" not in text
    assert "<img" not in text
    page = Reader(text)
    assert " ".join(nasty.split()) in page.text


def test_the_rod_and_the_blocked_connectors_are_shown(audited):
    made, verdict = audited
    sheet = verdict.assembly.end_effector
    blocked = [connector for connector in sheet.connectors if connector.blocked_by]
    page = Reader(render(design_page(made, verdict, "mine.json")))
    drawn = json.loads(page.data["view-data"])["parts"]
    assert ("rod" in {part["name"] for part in drawn}) == (sheet.mount is not None)
    marked = [len(part["modules"]) for part in drawn if part["name"] == "connectors blocked for the rod"]
    assert sum(marked) == len(blocked) > 0
    assert (f"from port {PORT_NAMES[sheet.mount.port]} of module {sheet.mount.module}" in page.text) or sheet.note


def test_the_mark_is_where_the_audit_says(audited):
    made, verdict = audited
    pair = next(pair for pair in verdict.pairs if pair.kind == "directional")
    *_, mark = scene(made, platform(made), pair)
    radius = 0.08 * made.task.module.arm_length
    for end in np.array(pair.closest_m):
        assert np.linalg.norm(mark.mesh.vertices - end, axis=1).min() == pytest.approx(radius / 4, rel=0.02)
    without = pair.model_copy(update={"closest_m": None})  # as in files of programs that do not tell
    assert "closest" not in {part.kind for part in scene(made, platform(made), without)}


def test_a_solid_plane_is_a_wall_beside_the_platform():
    made = read_json(Design, Path(__file__).parent / "designs" / "wall-push.json")
    at = platform(made)
    (wall,) = (part for part in scene(made, at) if part.kind == "walls")
    assert wall.name == "solid region"
    assert wall.mesh.vertices[:, 0].min() == pytest.approx(at.end_effector[0])  # it begins where the platform ends


def test_only_critical_clearances_have_a_colour(audited):
    made, found = audited
    pair = next(pair for pair in found.pairs if pair.kind == "airflow" and (pair.a, pair.b) == (0, 1))
    changed = [
        pair.model_copy(update={"a": a, "b": b, "status": status, "analytic_m": size})
        for a, b, status, size in ((0, 1, "clear", 0.0101), (0, 2, "clear", 0.00999), (1, 2, "violated", -0.1))
    ]
    _, figure = next(iter(clearance_matrices(made, found.model_copy(update={"pairs": tuple(changed)}))))
    heat, text = figure["data"]
    assert [heat["z"][i][j] for i, j in ((0, 1), (1, 0), (0, 2), (2, 1))] == [0, 0, 1, 2]
    assert heat["z"][3][4] is None
    told = dict(zip(zip(text["y"], text["x"], strict=True), text["text"], strict=True))
    assert [told["0", "1"], told["0", "2"], told["1", "2"]] == ["10.1", "9.99", "−100"]


def test_the_gap_of_a_design_is_computed_and_not_read_from_its_file(tmp_path):
    file = Path(__file__).parent / "designs" / "forged-gap.json"
    made = read_design(file)
    assert read_json(Design, file).gap == pytest.approx(1e-4)
    assert made.gap == pytest.approx(1 - nlp.lower_bound(made.task) / made.objective)
    assert made.gap > 0.015
    page = Reader(write_report(file, out=tmp_path / "page.html").read_text())
    assert gap_percent(made.gap) in page.text
    assert "0.01 %" not in page.text


def test_a_page_is_written_again_only_if_it_would_show_something_else(tmp_path, monkeypatch):
    page, pages = tmp_path / "run" / "report.html", []

    def spy(folder):
        pages.append(folder)
        write_run_page(folder)

    monkeypatch.setattr("topo_search.report.run_page.write_run_page", spy)

    def count(starts):
        pages.clear()
        toy_run(tmp_path / "run", starts=starts, report=write_page)
        return len(pages)

    assert (count(4), count(4), count(5), count(5)) == (1, 0, 1, 0)
    page.unlink()
    assert (count(5), count(5)) == (1, 0)
    page.write_text(page.read_text().replace("toy", "tay", 1))
    with pytest.raises(BadInput, match="is not the file that this run wrote"):
        count(5)


# ---- The page of a large run stays small: ten thousand candidates, solved twice each.

NUMBER = 10_000


def result(number: int, candidate: Candidate, solved: Design) -> tuple[Row, Design | Infeasible]:
    """Return what becomes of a candidate: every third is infeasible, the others are copies of one design."""
    key, margin = candidate.key, solved.task.search.margin
    if number % 3 == 0:
        pair = f"airflow of modules {number % 7} and {number % 7 + 1}"
        outcome = infeasible(candidate.topology, worst_constraint=pair, violation=0.001 * number, unit="m")
    else:
        objective = value(key, 0, 0, margin)
        inputs = ((math.sqrt(objective / 36),) * 36,)
        own = {"topology": candidate.topology, "topology_key": key, "objective": objective}
        outcome = solved.model_copy(update={**own, "rotor_speeds_squared": inputs})
    row = row_of(outcome, key, 9, 1, 1, BOUND, LEAST_EFFORT)
    return replace(row, margin=margin), outcome


def test_ten_thousand_candidates_take_less_than_six_megabytes(tmp_path):
    request = Request(toy_task(9), "none", starts=1, seed=0)
    (context, *_), path = request.contexts(9), tmp_path / "run"
    with RunFolder.open(path, request) as folder:
        folder.ledger.add_context(context, lower_bound(context.task), None)
        drawn = list(itertools.islice(candidates(9), NUMBER))
        assert len(drawn) == NUMBER
        solved = solve(Job(context.task, drawn[0].topology, starts=range(1), seed=0))
        rows = [result(number, candidate, solved) for number, candidate in enumerate(drawn)]
        ranked = sorted(rows, key=lambda pair: (pair[0].objective or math.inf, pair[0].key))
        shown = {row.key for row, _ in ranked[:SHOWN]}
        for _ in range(2):
            folder.ledger.record(context, [(row, found if row.key in shown else None) for row, found in rows])
        write_run_page(folder)
    page = path / "report.html"
    assert page.stat().st_size < 6e6
    text = page.read_text(encoding="utf-8")
    (data,) = re.findall(r'id="ranking-data">(.*?)</script>', text, re.DOTALL)
    assert len(json.loads(data)["rows"]) == NUMBER
    assert "airflow of two modules" in text
    assert text.count("<tr>") < 200
