"""The notebooks: stripped in git, and each runs top to bottom from a fresh kernel, with small settings.

None is marked slow though each takes over ten seconds: `make test` is to run them all. With `KEEP=1` what they show
is kept in `docs/executed`, which the site is built from.
"""

import ast
import os
import re
import shutil
from base64 import b64decode, b64encode
from io import BytesIO
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from PIL import Image

NOTEBOOKS = Path(__file__).parents[1] / "notebooks"
EXECUTED = NOTEBOOKS.parent / "docs/executed"
BOOKS = sorted(NOTEBOOKS.glob("*.ipynb"))

BEFORE = """
def search_in_this_process():
    import sys

    sys.path.append(TESTS)
    from toy_problem import InProcess

    from topo_search.compose import binding, searching
    from topo_search.experiments import study

    binding.Workers = study.Workers = InProcess
    searching.write_page = lambda folder: None

def check_figures():
    from matplotlib.backend_bases import FigureCanvasBase

    print_figure = FigureCanvasBase.print_figure

    def checked(canvas, *args, **options):
        figure = canvas.figure
        for axes in figure.axes:
            titled = axes.get_title() or figure.get_suptitle()
            across = [other.get_xlabel() for other in axes.get_shared_x_axes().get_siblings(axes)]
            up = [other.get_ylabel() for other in axes.get_shared_y_axes().get_siblings(axes)]
            if axes.axison and not (titled and any(across) and any(up)):
                raise RuntimeError(f"figure without a title or the name of an axis: {titled!r}, {across}, {up}")
        return print_figure(canvas, *args, **options)

    FigureCanvasBase.print_figure = checked

search_in_this_process()
check_figures()
"""
"""Runs first: each worker would load solver, audit and compiled code anew, and no notebook shows the page of a run;
every figure is to have its labels."""

FEWER = """
def compute_less():
    from dataclasses import replace

    from topo_search import experiments

    def conduct(study, settings, *given, conduct=experiments.conduct, **options):
        return conduct(study, replace(settings, topologies=(1, 1)), *given, **options)

    experiments.conduct = conduct

compute_less()
"""
"""Runs next, unless what the notebooks show is kept: a tree of each size."""


@pytest.fixture(params=BOOKS, ids=[book.stem for book in BOOKS])
def book(request: pytest.FixtureRequest) -> Path:
    return request.param


def test_they_are_numbered():
    assert [book.name[:2] for book in BOOKS] == [f"{number}_" for number in range(1, 9)]


def test_git_holds_no_output_and_no_path_of_a_machine(book):
    text = book.read_text(encoding="utf-8")
    content = nbformat.reads(text, as_version=4)
    nbformat.validate(content)
    assert nbformat.writes(content) + "\n" == text  # as Jupyter writes it: indented by one, keys sorted
    assert content.metadata == {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    assert len({cell.id for cell in content.cells}) == len(content.cells)
    for cell in content.cells:
        assert cell.metadata == {}
        assert not re.search(r"(^|[\s\"'(=])(/\w+/\w|~/|[A-Z]:\\)", cell.source), cell.id
        if cell.cell_type == "code":
            assert cell.outputs == []
            assert cell.execution_count is None
            assert "Markdown(" not in cell.source  # a cell is what a user would write: no code that makes prose


PUBLIC = ("topo_search", "topo_search.experiments", "topo_search.topologies")


def imports(book: Path) -> list[str]:
    """The modules from which a notebook imports."""
    code = "\n".join(cell.source for cell in nbformat.read(book, as_version=4).cells if cell.cell_type == "code")
    nodes = list(ast.walk(ast.parse(re.sub("^%.*", "", code, flags=re.MULTILINE))))
    modules = [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
    return modules + [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]


def test_no_private_module_is_imported(book):
    ours = [name for name in imports(book) if name.split(".")[0] in ("nlp", "topo_search", "verify")]
    assert ours
    assert [name for name in ours if name not in PUBLIC] == []


def test_runs_from_a_fresh_kernel(book, tmp_path, monkeypatch):
    monkeypatch.delenv("FULL", raising=False)
    for folder in ("pictures", "results"):
        if (NOTEBOOKS / folder).exists():
            shutil.copytree(NOTEBOOKS / folder, tmp_path / folder)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}
    content = nbformat.read(book, as_version=4)
    before_all = BEFORE.replace("TESTS", repr(str(Path(__file__).parent)))
    before_all += "" if os.environ.get("KEEP") else FEWER
    content.cells.insert(0, nbformat.v4.new_code_cell(before_all))
    NotebookClient(content, resources={"metadata": {"path": str(tmp_path)}}).execute()

    outputs = [output for cell in content.cells if cell.cell_type == "code" for output in cell.outputs]
    assert [output for output in outputs if output.output_type in ("stream", "error")] == []
    assert any("image/png" in output.data for output in outputs)
    assert {path: path.read_bytes() for path in before} == before  # only FULL=1 draws the README's pictures
    del content.cells[0]
    if os.environ.get("KEEP"):
        EXECUTED.mkdir(exist_ok=True)
        keep(content, EXECUTED / book.name)


def keep(content: nbformat.NotebookNode, path: Path) -> None:
    """Write what the site shows: a picture in few colours rather than its data, and no times of this run."""
    for cell in content.cells:
        cell.metadata = {}
        if "outputs" in cell:  # without the lines of progress that have vanished
            cell.outputs = [output for output in cell.outputs if output.get("data") != {"text/plain": ""}]
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if "image/png" in data:
                picture, small = Image.open(BytesIO(b64decode(data["image/png"]))), BytesIO()
                picture.convert("RGB").quantize(64).save(small, "PNG", optimize=True)
                output.data = {"image/png": b64encode(small.getvalue()).decode()}
            else:
                output.data = {kind: value for kind, value in data.items() if not kind.startswith("application/")}
    nbformat.write(content, path)


def test_the_site_shows_each_as_it_stands(book):
    kept, source = (nbformat.read(path, as_version=4).cells for path in (EXECUTED / book.name, book))
    assert [cell.source for cell in kept] == [cell.source for cell in source], "run `make notebooks-docs`"
