"""Flights on the page of a design: what is told of them, of whom they must be, and files that are damaged."""

import json
from functools import partial

import pytest
from commands import invoke
from report_cases import Reader, design, flown

from topo_search.compose import audit
from topo_search.model import Topology
from topo_search.model.files import to_json
from topo_search.report.design_page import design_page, read_simulated
from topo_search.report.page import render
from topo_search.simulation.result import NO_DOWNWASH

NASTY = "</script><script>alert(1)</script>"


@pytest.fixture(scope="module")
def audited():
    made = design(Topology.from_key("a0"))
    return made, audit(made)


def test_the_section_has_verdicts_course_and_what_a_simulation_cannot_know(audited, tmp_path):
    made, verdict = audited
    text = render(design_page(made, verdict, "mine.json", read_simulated(flown(made, tmp_path), made)))
    page = Reader(text)
    assert "Flight in simulation: saturated" in page.text
    assert "load case 0, wall saturated 1.23 cm 3.25° 6.0 % 50.0 % 100.0 % drifted" in page.text
    assert "load case 1 not flown not a steady flight" in page.text
    assert "0.5 N in the weakest direction (-y), 2 % of the weight; it hovers statically after 3 of 4" in page.text
    assert "motor lag 50 ms, sensor noise × 1, model error 2 %, seed 7." in page.text
    assert NO_DOWNWASH in page.text
    assert "It does not affect the audit's verdict." in page.text
    assert f"audit: {verdict.verdict}" in page.text
    drawn = json.loads(page.data["simulated-course-data"])["data"]
    assert {trace["name"] for trace in drawn} == {"load case 0, wall"}
    assert len(drawn) == 3
    assert all(link.startswith("#") for link in page.links)
    assert "simulated" in page.ids


def test_flights_of_files_without_outcomes_are_shown_by_their_verdicts(audited, tmp_path):
    made, verdict = audited
    told = json.loads((flown(made, tmp_path) / "flight.json").read_text())
    for one in (told, *told["scenarios"]):
        del one["outcome"]
    (tmp_path / "flight.json").write_text(json.dumps(told))
    page = Reader(render(design_page(made, verdict, "mine.json", read_simulated(tmp_path, made))))
    assert "Flight in simulation: not recovered" in page.text
    assert "load case 0, wall not recovered 1.23 cm" in page.text


def test_names_of_scenarios_stay_text(audited, tmp_path):
    made, verdict = audited
    part = read_simulated(flown(made, tmp_path, NASTY), made)
    text = render(design_page(made, verdict, "mine.json", part))
    assert "<script>alert" not in text
    assert NASTY in Reader(text).text


@pytest.fixture
def command(tmp_path, monkeypatch, audited):
    """The command in a folder with a design, its flights, and another design."""
    monkeypatch.chdir(tmp_path)
    made, _ = audited
    (tmp_path / "mine.json").write_text(to_json(made))
    (tmp_path / "other.json").write_text(to_json(made.model_copy(update={"end_effector_m": (0.5, 0.2, 0.4)})))
    flown(made, tmp_path / "flight")
    (tmp_path / "run").mkdir()
    return partial(invoke, "report")


def test_the_command_reads_the_folder_of_fly(command, tmp_path):
    assert command("mine.json", "--flight", "flight").stdout == "the page is in mine.html\n"
    assert "Flight in simulation: saturated" in (tmp_path / "mine.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "edit", "said"),
    [
        (["other.json"], None, "flight.json: design: must be the digest of this design"),
        (["run"], None, "--flight: must come with the file of the design that was flown, but got the folder run"),
        (["mine.json"], ("csv", "0.03", "far"), "flight.csv: could not convert string to float: 'far'"),
    ],
)
def test_flights_that_do_not_fit_are_refused(command, tmp_path, words, edit, said):
    if edit is not None:
        kind, old, new = edit
        path = tmp_path / "flight" / f"flight.{kind}"
        path.write_text(path.read_text().replace(old, new, 1))
    assert said in " ".join(command(*words, "--flight", "flight", status=2).stderr.split())
    assert not list(tmp_path.rglob("*.html"))
