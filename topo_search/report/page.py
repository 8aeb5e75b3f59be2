"""The page as one file: a template that escapes every text, with plotly.js and three.js inside."""

from __future__ import annotations

import base64
import functools
import gzip
import json
import re
from collections.abc import Collection, Sequence
from importlib import resources
from typing import Any, NamedTuple

import jinja2
import trimesh
from markupsafe import Markup, escape
from trimesh.viewer import scene_to_html

from topo_search.export import palette

Figure = dict[str, Any]
"""Data and layout of a figure, as plotly.js takes them."""
LOOK: dict[str, Any] = {
    "font": {"family": "system-ui, sans-serif", "size": 13, "color": "#222222"},
    "paper_bgcolor": "rgba(0,0,0,0)",
    "plot_bgcolor": "rgba(0,0,0,0)",
    "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": "#777777", "activecolor": "#0072b2"},
    "autosize": True,
    "margin": {"l": 60, "r": 20, "t": 36, "b": 50},
}
"""Layout of all figures."""


class Chart(NamedTuple):
    """A figure with what it shows in words."""

    name: str
    """Name of its element: letters, digits and dashes."""
    caption: str
    figure: Figure


class Table(NamedTuple):
    """A table with a heading a column."""

    columns: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    numeric: Collection[int] = ()
    """Columns of numbers, which are aligned to the right."""

    @classmethod
    def from_rows(cls, rows: Sequence[dict[str, str]], numeric: Collection[int] = ()) -> Table:
        """Return a table of rows that have the same headings, each beside its cell."""
        return cls(tuple(rows[0]) if rows else (), [list(row.values()) for row in rows], numeric)


class Tile(NamedTuple):
    """A figure of the headline."""

    name: str
    figure: str
    meaning: str
    status: str = ""
    """A verdict that colours it, or `fragile`; empty for none."""


def render(page: dict[str, Any]) -> str:
    """Return the page as the text of an HTML file that needs nothing but itself."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("topo_search.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    # parts that a page may lack, then those that only some kinds of page have
    absent = dict.fromkeys(("key", "verdict", "design", "meshes", "task", "bound", "reproduction"))
    absent |= dict.fromkeys(("run", "front", "compared", "simulated"))
    # in the order in which they run
    scripts = ("figures", "labels", "stage", "air", "view", "beside", "choice", "ranking", "page")
    environment.filters |= {"json": json_in_script, "code": mark_code}
    return environment.get_template("page.html.j2").render(
        page={**absent, "fragile": (), "notes": (), **page},
        palette=palette,
        FIRST_TILES=6,  # beside the view
        style=_template("page.css"),
        script=Markup("\n").join(_template(f"{name}.js") for name in scripts),
        look={"template": json.loads(_of_plotly("templates/plotly_white.json")), **LOOK},
        libraries=_libraries(),
    )


@functools.cache
def _libraries() -> str:
    """Return plotly.js and three.js as gzip in base64, which is a third of their size.

    trimesh ships three.js inside of the page of its own viewer: a licence with a line of code below.
    """
    viewer = scene_to_html(trimesh.Scene(trimesh.creation.box()))
    match = re.search(r"/\*\*\s+\* @license[^/]*Three\.js Authors[^/]*\*/\n.+", viewer)
    assert match is not None  # as in every version that the project allows
    code = f"{_of_plotly('plotly.min.js')}\n{match.group()}"
    compressed = gzip.compress(code.encode(), 6, mtime=0)  # a higher level takes longer and gains 0.2 %
    return base64.b64encode(compressed).decode()


def _of_plotly(name: str) -> str:
    return (resources.files("plotly") / "package_data" / name).read_text(encoding="utf-8")


def mark_code(text: str) -> Markup:
    """Return a text with its names between backticks as code."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def json_in_script(value: Any) -> Markup:
    """Return a value as JSON inside a script element."""
    text = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    # no text in the JSON can end the script element
    return Markup(text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029"))


def _template(name: str) -> Markup:
    # the package's files are trusted
    return Markup((resources.files("topo_search.report") / "templates" / name).read_text(encoding="utf-8"))
