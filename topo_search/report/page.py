"""The report as one HTML file: a template that escapes every text, with plotly.js and three.js embedded."""

import base64
import functools
import gzip
import io
import json
import re
import zipfile
from collections.abc import Sequence
from importlib import metadata, resources
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup, escape

from topo_search.export import palette
from topo_search.export.poses import poses_to_draw
from topo_search.export.tree_drawing import tree_svg
from topo_search.model import Audit, Design
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
    absent = dict.fromkeys(
        ("key", "design", "audit", "task", "bound", "polytopes", "reproduction", "run", "front", "compared", "miss")
    )
    page = {**absent, "simulated": None, "notes": (), "sizes": (), "advice": (), "bounded": "lower bound", **page}
    design, audit = page["design"], page["audit"]
    pictured, judged = (design, audit) if page["miss"] is None else (page["miss"]["design"], page["miss"]["audit"])
    flights = page["simulated"]["flights"] if page["simulated"] else ()
    plotly_white = json.loads(_content("plotly", "package_data/templates/plotly_white.json"))
    return _template("page.html.j2").render(
        page=page,
        design=design,
        audit=audit,
        pictured=pictured,
        drawn=pictured
        and view(pictured, poses_to_draw(pictured), judged, forces=pictured is design, flights=flights),
        FIRST_TILES=6,  # as many as fit beside the view
        style=_file("page.css"),
        script=_script(*IN_VIEW, "comparison", "choice", "ranking", "page"),
        look={"template": plotly_white, **PLOTLY_LAYOUT},
        libraries=_plotly_and_three(),
    )


IN_VIEW = ("figures", "labels", "stage", "air", "view")
"""Scripts of a 3-D view, in order of execution."""


def render_view(design: Design, audit: Audit, flights: Sequence[dict[str, Any]] = ()) -> str:
    """Return a page with nothing but the 3-D view of a design, which starts when it is looked at.

    Args:
        design: the design.
        audit: its audit.
        flights: flights to play.
    """
    drawn = view(design, poses_to_draw(design), audit, flights=flights)
    data = {"view-data": drawn, "meshes": shared_meshes(design)}
    packed = {name: json.dumps(value, allow_nan=False) for name, value in data.items()}
    code = f"{_three()}\n{_script(*IN_VIEW, 'cell')}"
    return _template("cell.html.j2").render(
        design=design,
        drawn=drawn,
        style=_file("page.css"),
        packed=_pack(json.dumps({"data": packed, "code": code})),
    )


@functools.cache
def _template(name: str) -> jinja2.Template:
    """Return a template, with all functions that pages call."""
    loader, strict = jinja2.PackageLoader("topo_search.report"), jinja2.StrictUndefined
    environment = jinja2.Environment(
        loader=loader, autoescape=True, undefined=strict, trim_blocks=True, lstrip_blocks=True
    )
    functions = (shared_meshes, task_warnings, thumbnail, to_toml, tree_svg, Table)
    modules = (charts, design_part, headline, task_facts, wording)
    environment.globals |= {each.__name__.rpartition(".")[2]: each for each in (*functions, *modules)}
    environment.globals["palette"] = palette
    environment.filters |= {"json": lambda value: Markup(json_in_script(value)), "code": mark_code}
    return environment.get_template(name)


def _three() -> str:
    """Return three.js, from the page of trimesh's viewer: a licence comment followed by a line of code."""
    with zipfile.ZipFile(io.BytesIO(_content("trimesh", "resources/templates/viewer.zip"))) as archive:
        viewer = archive.read("viewer.html.template").decode()
    match = re.search(r"/\*\*\s+\* @license[^/]*Three\.js Authors[^/]*\*/\n.+", viewer)
    assert match is not None  # in every version of trimesh that the project allows
    return match.group()


@functools.cache
def _plotly_and_three() -> str:
    return _pack(f"{_content('plotly', 'package_data/plotly.min.js').decode()}\n{_three()}")


def _pack(text: str) -> str:
    """Return a text compressed by gzip, to a third of its size for libraries, in base64."""
    return base64.b64encode(gzip.compress(text.encode(), 6, mtime=0)).decode()  # a higher level gains 0.2 %


def _content(package: str, file: str) -> bytes:
    return Path(str(metadata.distribution(package).locate_file(f"{package}/{file}"))).read_bytes()


def mark_code(text: str) -> Markup:
    """Return a text as HTML, with names in backticks as code."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def _script(*names: str) -> Markup:
    return Markup("\n").join(_file(f"{name}.js") for name in names)


def _file(name: str) -> Markup:
    # files of the package are trusted
    return Markup((resources.files("topo_search.report") / "templates" / name).read_text(encoding="utf-8"))
