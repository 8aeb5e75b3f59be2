"""Notebook cells: the 3-D view of a design, a page of its own in a frame, and pictures."""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, Self

from topo_search.limits import quantity
from topo_search.model import Audit, Design, Task
from topo_search.model.files import write_atomically

INVERTED = ':is([data-jp-theme-light="false"], .vscode-dark) .topo-search { filter: invert(1) hue-rotate(180deg); }'
"""Style of pictures with dark ink in a dark notebook: light ink, and the same hues."""


@dataclass(frozen=True)
class View:
    """A 3-D view, which a notebook shows in a cell; it works offline."""

    title: str
    html: str
    """The page; three.js is inside."""

    @classmethod
    def of(cls, design: Design, audit: Audit, flights: Sequence[dict[str, Any]] = ()) -> Self:
        """Return the view of a design, and of flights as `flights_of` returns them."""
        from topo_search.report.page import render_view  # slow to import

        title = f"{design.task.name}: {quantity(design.topology.n, 'module')}, {design.topology.key}"
        return cls(title, render_view(design, audit, flights))

    def write_html(self, path: str | Path) -> None:
        """Write the page to a file."""
        write_atomically(Path(path), self.html)

    def __repr__(self) -> str:
        return f"<3-D view of {self.title}>"

    def _repr_html_(self) -> str:
        page = escape(self.html).replace("\n", "&#10;")  # one line, so that Markdown leaves it alone
        frame = 'style="width: 100%; height: 560px; border: 0" loading="lazy"'
        return f'<iframe title="{escape(repr(self)[1:-1])}" {frame} srcdoc="{page}"></iframe>'


@dataclass(frozen=True)
class Picture:
    """The picture of a design with its tree, or of a task around its end-effector, which a notebook displays."""

    of: Design | Task

    def _repr_mimebundle_(self, **_: object) -> tuple[dict[str, str], dict[str, str]]:
        """Return the picture as HTML and as PNG, which a dark notebook has to put on a light ground."""
        from topo_search.export.picture import content, figure_of  # imports matplotlib, from the extra `viz`
        from topo_search.export.task_picture import task_figure

        if isinstance(self.of, Design):
            figure, name = figure_of(self.of), self.of.task.name
        else:
            figure, name = task_figure(self.of.resolve(self.of.sizes[-1])), self.of.name
        png = b64encode(content(figure, "png", dpi=150)).decode()
        look = f'class="topo-search" alt="picture of {escape(name)}" style="width: min(100%, 860px)"'
        html = f'<style>{INVERTED}</style><img {look} src="data:image/png;base64,{png}">'
        return {"text/html": html, "image/png": png}, {"needs_background": "light"}
