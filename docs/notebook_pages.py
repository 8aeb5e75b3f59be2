"""The notebooks as pages of the site, with the outputs that `make test` kept: none is run while it is built."""

from __future__ import annotations

import re
from pathlib import Path

import nbformat
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from nbconvert import MarkdownExporter
from traitlets.config import Config

HERE = Path(__file__).parent
NOTEBOOKS = HERE.parent / "notebooks"
EXECUTED = HERE / "executed"
SHOWN = ["image/png", "image/gif", "text/html", "text/markdown", "text/plain"]
"""Kinds of output, the preferred one first: interactive pictures would put megabytes of scripts into a page."""
FORMULA = re.compile(r"\$\$(?P<block>.+?)\$\$|\$(?P<inline>[^$]+)\$", re.DOTALL)
LEFT_OUT = "*Cells are shown without their outputs: `make test` runs them, and keeps the outputs for this site.*"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each notebook, and its pictures."""
    exporter = MarkdownExporter(config=Config(NbConvertBase={"display_data_priority": SHOWN}))
    for book in sorted(NOTEBOOKS.glob("*.ipynb")):
        kept = EXECUTED / book.name
        content = nbformat.read(kept if _current(kept, book) else book, as_version=4)
        for cell in content.cells:
            if cell.cell_type == "markdown":
                cell.source = FORMULA.sub(_mathml, cell.source)
            for output in cell.get("outputs", []):
                _without_scripts(output)
        name = f"tutorials/notebooks/{book.stem}"
        body, resources = exporter.from_notebook_node(
            content, {"output_files_dir": book.stem, "unique_key": book.stem}
        )
        if not _current(kept, book):
            head, _, rest = body.partition("\n")
            body = f"{head}\n\n{LEFT_OUT}\n{rest}"
        body = re.sub(r"<style scoped>.*?</style>", "", body, flags=re.DOTALL)
        files.append(File.generated(config, f"{name}.md", content=body))
        for path, picture in resources["outputs"].items():
            files.append(File.generated(config, f"tutorials/notebooks/{path}", content=picture))
    return files


def _mathml(formula: re.Match[str]) -> str:
    """Return a formula as browsers draw it, without a script."""
    if formula["block"] is not None:
        return convert(" ".join(formula["block"].split()), display="block")
    return convert(formula["inline"])


def _current(kept: Path, book: Path) -> bool:
    """Whether a notebook was run as it stands."""
    if not kept.exists():
        return False
    sources = [[cell.source for cell in nbformat.read(path, as_version=4).cells] for path in (kept, book)]
    return sources[0] == sources[1]


def _without_scripts(output: nbformat.NotebookNode) -> None:
    if "<script" in str(output.get("data", {}).get("text/html", "")):
        del output.data["text/html"]
        output.data["text/plain"] = "(an interactive picture, in the notebook itself)"
