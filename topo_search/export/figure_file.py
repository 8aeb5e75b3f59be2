"""Figures as files: the same figure gives the same bytes."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Literal

import matplotlib as mpl
from matplotlib.figure import Figure

from topo_search.model.files import write_atomically


def save(figure: Figure, path: str | Path, *, format: Literal["png", "svg"] | None = None) -> None:
    """Write a figure.

    Args:
        figure: a figure that no window shows.
        path: the file; its folder is made if need be.
        format: the kind of file; default: by the end of its name.

    Raises:
        ValueError: neither `format` nor the name says `png` or `svg`.
    """
    path = Path(path)
    kind = format or path.suffix.removeprefix(".").lower()
    if kind not in ("png", "svg"):
        raise ValueError(f"the picture's name must end in .png or .svg, but got {path.name}")
    write_atomically(path, content(figure, kind))


def content(figure: Figure, kind: str) -> bytes:
    """Return a figure as the content of a `png` or `svg` file."""
    stream = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "topo-search"}):
        figure.savefig(stream, format=kind, dpi=200, metadata={"Date": None} if kind == "svg" else None)
    return stream.getvalue()
