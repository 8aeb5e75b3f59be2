"""Pages of the site from the notebooks with their stored outputs (`make notebooks-docs`); the build runs none."""

from __future__ import annotations

import re
from pathlib import Path

import nbformat
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from nbconvert import MarkdownExporter
from traitlets.config import Config

EXECUTED = Path(__file__).parent / "executed"
SHOWN = ["image/png", "image/gif", "text/html", "text/markdown", "text/plain"]
"""Kinds of output by preference, without the interactive ones: their scripts would add megabytes to a page."""
FORMULA = re.compile(r"\$\$(?P<block>.+?)\$\$|\$(?P<inline>[^$]+)\$", re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page per notebook, and its pictures."""
    exporter = MarkdownExporter(config=Config(NbConvertBase={"display_data_priority": SHOWN}))
    for book in sorted(EXECUTED.glob("*.ipynb")):
        content = nbformat.read(book, as_version=4)
        for cell in content.cells:
            if cell.cell_type == "markdown":
                cell.source = FORMULA.sub(_mathml, cell.source)
            for output in cell.get("outputs", []):
                _without_scripts(output)
        name = f"tutorials/notebooks/{book.stem}"
        body, resources = exporter.from_notebook_node(
            content, {"output_files_dir": book.stem, "unique_key": book.stem}
        )
        body = re.sub(r"<style scoped>.*?</style>", "", body, flags=re.DOTALL)
        files.append(File.generated(config, f"{name}.md", content=body))
        for path, picture in resources["outputs"].items():
            files.append(File.generated(config, f"tutorials/notebooks/{path}", content=picture))
    return files


def _mathml(formula: re.Match[str]) -> str:
    """Return a formula as MathML, which browsers draw without a script."""
    if formula["block"] is not None:
        return f"\n\n<div>{convert(' '.join(formula['block'].split()), display='block')}</div>\n\n"
    return convert(formula["inline"])


def _without_scripts(output: nbformat.NotebookNode) -> None:
    if "<script" in str(output.get("data", {}).get("text/html", "")):
        del output.data["text/html"]
        output.data["text/plain"] = "(an interactive picture, in the notebook itself)"
