"""Page of a drawer of brackets: its brackets, the design of each task, and every change."""

from collections.abc import Iterable, Iterator, Sequence
from html import escape

from topo_search.compose.shared_kit import Change, SharedKit
from topo_search.export.brackets import DIGITS
from topo_search.export.html_page import html_page
from topo_search.export.sheet import STYLE
from topo_search.export.tree_drawing import tree_svg
from topo_search.model import Design
from topo_search.model.html import paragraph, table


def drawer_page(shared: SharedKit, designs: Sequence[Design]) -> str:
    """Return the page of a kit: its brackets, the design of each task, and every change."""
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


def change_lines(change: Change, before: Design, after: Design) -> Iterator[str]:
    """Yield drawings of both platforms, with the joints that stay in green, and the steps in order."""
    yield f"<h2>From {escape(change.before)} to {escape(change.after)}</h2>"
    stays = zip((before, after), zip(*change.stay, strict=True), strict=True)
    yield _side_by_side((escape(design.task.name), tree_svg(design, marked=stay)) for design, stay in stays)
    yield paragraph(
        "Joints that stay are green. Modules come off, and are added, one at a time; the others stay in one piece."
    )
    yield from (paragraph(text) for text in change.instructions)
    yield paragraph(
        f"Then mount rod and end-effector as in the last step of the assembly sheet of {escape(change.after)}, "
        "and load the allocation of that kit into the autopilot."
    )


def _side_by_side(drawings: Iterable[tuple[str, str]]) -> str:
    figures = (f"<figure><figcaption>{caption}</figcaption>{svg}</figure>" for caption, svg in drawings)
    return f"<section>{''.join(figures)}</section>"
