"""The report as one HTML file: a template that escapes every text, with plotly.js and three.js embedded."""

import base64
import functools
import gzip
import io
import json
import re
import zipfile
from importlib import metadata, resources
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup, escape

from topo_search.export import palette
from topo_search.export.poses import poses_to_draw
from topo_search.export.tree_drawing import tree_svg
from topo_search.model.files import to_toml
from topo_search.report import (
    PLOTLY_LAYOUT,
    Table,
    charts,
    design_part,
    headline,
    json_in_script,
    task_facts,
    wording,
)
from topo_search.report.scene import shared_meshes
from topo_search.report.task_warnings import task_warnings
from topo_search.report.view import thumbnail, view


def render(page: dict[str, Any]) -> str:
    """Return the page as the text of a self-contained HTML file."""
    loader, strict = jinja2.PackageLoader("topo_search.report"), jinja2.StrictUndefined
    environment = jinja2.Environment(
        loader=loader, autoescape=True, undefined=strict, trim_blocks=True, lstrip_blocks=True
    )
    absent = dict.fromkeys(
        ("key", "design", "audit", "task", "bound", "polytopes", "reproduction", "run", "front", "compared", "miss")
    )
    page = {**absent, "simulated": None, "notes": (), "sizes": (), "advice": (), "bounded": "lower bound", **page}
    design, audit = page["design"], page["audit"]
    pictured, judged = (design, audit) if page["miss"] is None else (page["miss"]["design"], page["miss"]["audit"])
    # in order of execution
    scripts = ("figures", "labels", "stage", "air", "view", "comparison", "choice", "ranking", "page")
    functions = (shared_meshes, task_warnings, thumbnail, to_toml, tree_svg, Table)
    modules = (charts, design_part, headline, task_facts, wording)
    called = {each.__name__.rpartition(".")[2]: each for each in (*functions, *modules)}
    environment.filters |= {"json": lambda value: Markup(json_in_script(value)), "code": mark_code}
    plotly_white = json.loads(_content("plotly", "package_data/templates/plotly_white.json"))
    return environment.get_template("page.html.j2").render(
        page=page,
        design=design,
        audit=audit,
        pictured=pictured,
        drawn=pictured and view(pictured, poses_to_draw(pictured), judged, forces=pictured is design),
        FIRST_TILES=6,  # as many as fit beside the view
        style=_template("page.css"),
        script=Markup("\n").join(_template(f"{name}.js") for name in scripts),
        look={"template": plotly_white, **PLOTLY_LAYOUT},
        libraries=_libraries(),
        palette=palette,
        **called,
    )


@functools.cache
def _libraries() -> str:
    """Return plotly.js and three.js, compressed by gzip to a third of their size, in base64.

    three.js is taken from the page of trimesh's viewer, where it is a licence comment followed by a line of code.
    """
    with zipfile.ZipFile(io.BytesIO(_content("trimesh", "resources/templates/viewer.zip"))) as archive:
        viewer = archive.read("viewer.html.template").decode()
    match = re.search(r"/\*\*\s+\* @license[^/]*Three\.js Authors[^/]*\*/\n.+", viewer)
    assert match is not None  # in every version of trimesh that the project allows
    code = f"{_content('plotly', 'package_data/plotly.min.js').decode()}\n{match.group()}"
    compressed = gzip.compress(code.encode(), 6, mtime=0)  # a higher level takes longer and gains 0.2 %
    return base64.b64encode(compressed).decode()


def _content(package: str, file: str) -> bytes:
    return Path(str(metadata.distribution(package).locate_file(f"{package}/{file}"))).read_bytes()


def mark_code(text: str) -> Markup:
    """Return a text as HTML, with names in backticks as code."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def _template(name: str) -> Markup:
    # files of the package are trusted
    return Markup((resources.files("topo_search.report") / "templates" / name).read_text(encoding="utf-8"))
