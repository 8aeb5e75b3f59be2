"""`topo-search report`: what it writes where, and what it says when it cannot; `run` writes its page by itself."""

import shutil

import pytest
from click.testing import CliRunner
from report_cases import design
from toy_problem import toy_run

from topo_search.cli import main
from topo_search.model import Topology
from topo_search.model.files import to_json


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run of the toy problem."""
    folder = tmp_path_factory.mktemp("finished") / "run"
    toy_run(folder)
    return folder


@pytest.fixture
def command(finished, tmp_path, monkeypatch):
    """The command in a folder with a run of the toy problem, a design, and one that cannot be drawn."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(finished, tmp_path / "run")
    (tmp_path / "mine.json").write_text(to_json(design(Topology.from_key("a0"))))
    (tmp_path / "far.json").write_text(to_json(design(Topology.from_key("a0"), end_effector_m=[1e200, 0.0, 0.0])))
    return lambda *words: CliRunner().invoke(main, ["report", *words], catch_exceptions=False)


@pytest.mark.parametrize(
    ("words", "page", "title"),
    [
        (["run"], "run/report.html", "toy: 3 modules, a"),
        (["run/", "--out", "deep/page.html"], "deep/page.html", "toy: 3 modules, a"),
        (["mine.json"], "mine.html", "push: 1 module, a0"),
        (["mine.json", "--out", "mine.page"], "mine.page", "push: 1 module, a0"),
    ],
)
def test_the_page_is_where_it_says(command, tmp_path, words, page, title):
    result = command(*words)
    assert (result.exit_code, result.stdout) == (0, f"the page is in {page}\n")
    assert f"<title>{title}" in (tmp_path / page).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nowhere"], "nowhere: no such file"),
        (["."], "is not a run folder: it has no ledger.sqlite"),
        (["run/task.toml"], "is not a JSON file"),
        (["run", "--out", "."], "is a directory"),
        (["far.json"], "end_effector_m: must be within"),
    ],
)
def test_bad_input_is_status_two_and_writes_nothing(command, tmp_path, words, said):
    result = command(*words)
    assert result.exit_code == 2
    assert said in " ".join(result.stderr.split())
    assert not [path for path in tmp_path.rglob("*") if path.suffix == ".html"]


@pytest.mark.parametrize(
    ("name", "out"),
    [
        ("best.json", ()),
        ("candidates.csv", ("--out", "page.html")),
        ("designs/a300.json", ()),
        ("task.toml", ("--out", "page.html")),
    ],
)
def test_a_file_that_somebody_changed_is_named_and_not_shown(command, tmp_path, name, out):
    path = tmp_path / "run" / name
    path.write_bytes(path.read_bytes() + b"\n")
    result = command("run", *out)
    assert result.exit_code == 0
    assert result.stderr == (
        f"warning: {name} is not the file that this run wrote; the page shows what the run wrote\n"
    )


@pytest.mark.usefixtures("in_process")
def test_a_run_ends_in_its_page(tmp_path):
    words = ["run", "push", "--modules", "1", "--starts", "1", "--out", str(tmp_path / "run")]
    result = CliRunner().invoke(main, words, catch_exceptions=False)
    assert result.exit_code == 3
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert "No design was found for push" in page
