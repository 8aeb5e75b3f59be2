"""Pages of a drawer: platforms side by side, with the joints that stay in one colour, and a sheet a change."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from html import escape
from typing import TYPE_CHECKING

from topo_search.export.brackets import DIGITS
from topo_search.export.sheet import STYLE
from topo_search.export.tree_drawing import tree_svg
from topo_search.model import Design
from topo_search.model.text import html_page, paragraph, table

if TYPE_CHECKING:
    from topo_search.compose.drawer import Change, SharedKit


def drawer_page(shared: SharedKit, designs: Sequence[Design]) -> str:
    """Return the page of a drawer: what is in it, the design of each task, and every change."""
    lines = [paragraph(text) for text in shared.lines[:2]]
    brackets = [(f"{kind.angle_deg:.{DIGITS}f}", kind.count, kind.file) for kind in shared.brackets]
    lines += ["<h2>Drawer</h2>", table(("hinge angle [deg]", "brackets", "to print"), brackets), "<h2>Tasks</h2>"]
    captions = [
        f'<a href="{escape(task.design.replace("design.json", "assembly.html"))}">{escape(task.task)}</a>'
        for task in shared.tasks
    ]
    lines.append(_side_by_side(zip(captions, map(tree_svg, designs), strict=True)))
    for number, change in enumerate(shared.changes):
        lines += change_lines(change, designs[number], designs[number + 1])
    return html_page(f"One drawer for {len(designs)} tasks", STYLE, lines)


def change_page(change: Change, before: Design, after: Design) -> str:
    """Return the sheet of one change."""
    return html_page(f"From {change.before} to {change.after}", STYLE, change_lines(change, before, after))


def change_lines(change: Change, before: Design, after: Design) -> Iterator[str]:
    """Yield the two platforms with the joints that stay in one colour, and the steps in order."""
    yield f"<h2>From {escape(change.before)} to {escape(change.after)}</h2>"
    stays = zip((before, after), zip(*change.stay, strict=True), strict=True)
    yield _side_by_side((escape(design.task.name), tree_svg(design, marked=stay)) for design, stay in stays)
    yield paragraph(
        "Joints that stay are green. Every module comes off the end of a piece, and is added to one piece."
    )
    yield from (paragraph(text) for text in change.instructions)
    yield paragraph(
        f"Then rod and end-effector go where the last step of the assembly sheet of {escape(change.after)} says, "
        "and the autopilot gets the allocation of that kit."
    )


def _side_by_side(drawings: Iterable[tuple[str, str]]) -> str:
    figures = (f"<figure><figcaption>{caption}</figcaption>{svg}</figure>" for caption, svg in drawings)
    return f"<section>{''.join(figures)}</section>"
