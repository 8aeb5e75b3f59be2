"""Pages: the report of a run or a design, the comparison of two, and pictures."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import nlp
from topo_search.compose.designs import audit, read_completed, with_bound
from topo_search.model import Audit, BadInput, Design
from topo_search.model.files import write_atomically
from topo_search.study import REPORT, Observer, RunFolder, answer_of
from topo_search.study.directory import CHANGED

if TYPE_CHECKING:
    from topo_search.report.design_page import Compared


def write_report(
    source: str | Path,
    *,
    out: str | Path | None = None,
    flight: str | Path | None = None,
    note: Callable[[str], None] = warnings.warn,
) -> Path:
    """Write the report of a run, or of a single design after auditing it, and return its path.

    Args:
        source: a run's folder or a design's file.
        out: the page; default: `report.html` in the folder, or the design's name with `.html`.
        flight: a folder that `fly --out` wrote for the design, whose flights are shown too.
        note: receives each file in a run's folder that differs from the ledger, which the page is made from.

    Raises:
        BadInput: the source is neither, or the flights are not of it; or the page would go into a folder that a
            run is using, or replace a file that the run did not write.
        RuntimeError: the audit failed; the message gives the reason.

    Example:
        >>> from topo_search import write_report
        >>> print(write_report("hover-2/best.json", out="best.html"))
        best.html
    """
    from topo_search.report.design_page import design_page, read_simulated
    from topo_search.report.page import render
    from topo_search.report.run_page import run_page, write_run_page

    source = Path(source)
    if source.is_dir() and flight is not None:
        rule = f"must come with the file of the design that was flown, but got the folder {source}"
        raise BadInput("--flight", rule)
    if source.is_dir() and out is None:
        with RunFolder.load(source, writes=True) as folder:
            _name_changed(folder, note)
            write_run_page(folder)
        return source / REPORT
    if source.is_dir():
        with RunFolder.load(source) as folder:
            _name_changed(folder, note)
            page = run_page(folder)
    else:
        design = read_completed(source)
        simulated = None if flight is None else read_simulated(Path(flight), design)
        page = design_page(with_bound(design, nlp.proven_bound(design.task)), audit(design), source.name, simulated)
    path = Path(out or source.with_suffix(".html"))
    write_atomically(path, render(page))
    return path


def _name_changed(folder: RunFolder, note: Callable[[str], None]) -> None:
    for name in folder.changed_files():
        note(f"warning: {name} {CHANGED}; the page shows what the run wrote")


def write_page(folder: RunFolder) -> None:
    """Write a run's page, unless it shows what it would again; only the coordinator loads what it takes."""
    if folder.page_is_current():
        return
    from topo_search.report.run_page import write_run_page

    write_run_page(folder)


@contextmanager
def follow_live(path: Path, observer: Observer, *, live: bool) -> Iterator[Observer]:
    """Return who observes a run: the same, or one that serves the page as well while the block runs."""
    if not live:
        yield observer
        return
    from topo_search.report.live import serve_live

    with serve_live(path, observer) as serving:
        yield serving


def plot_platform(design: Design, audited: Audit | None = None) -> Any:
    """Return an interactive 3-D Plotly figure of a design; given its audit, also the closest pair and the rod.

    Example:
        >>> from topo_search import plot_platform, read_answer
        >>> figure = plot_platform(read_answer("hover-2").design)
        >>> type(figure).__name__
        'Figure'
    """
    from topo_search.export.poses import poses_to_draw
    from topo_search.report.scene import closest, figure

    if not isinstance(design, Design):
        raise BadInput("design", f"must be a Design, but got {type(design).__name__}")
    return figure(design, poses_to_draw(design), closest(audited), None if audited is None else audited.assembly)


figure = plot_platform
"""Its name of old."""


def compare(first: str | Path, second: str | Path, *, out: str | Path | None = None) -> list[list[Compared]]:
    """Compare two runs, or designs, and return the designs of each, the best first.

    Args:
        first: a run's folder or a design's file.
        second: the other.
        out: where to write the page that shows them side by side; None for no page.

    Raises:
        BadInput: one of them is neither, or a run without a design.
        RuntimeError: the audit of a design failed; the message gives the reason.

    Example:
        >>> from topo_search import compare
        >>> [side[0].name for side in compare("hover-2", "hover-2/best.json")]
        ['hover-2/a10', 'best']
    """
    from topo_search.report.design_page import compare_page
    from topo_search.report.page import render

    sides = [_designs(Path(source)) for source in (first, second)]
    if out is not None:
        write_atomically(Path(out), render(compare_page(*sides)))
    return sides


def _designs(source: Path) -> list[Compared]:
    from topo_search.report.design_page import Compared
    from topo_search.report.headline import rows_to_show

    if not source.is_dir():
        design = read_completed(source)
        design = with_bound(design, nlp.proven_bound(design.task))
        judged = audit(design)
        return [Compared(source.stem, design, judged, design.gap if judged.verdict == "clear" else None)]
    with RunFolder.load(source) as folder:
        answer = answer_of(folder).at_level
        if answer.shown is None:
            raise BadInput(str(source), "holds no design yet")
        gaps = {size.modules: size.gap_of for size in answer.sizes}
        level = folder.levels[answer.level]
        read = ((row, *level.result_of(row)) for row in rows_to_show(answer, answer.shown))
        name = source.resolve().name
        return [
            Compared(f"{name}/{row.key}", design, audited, gaps[row.modules](row))
            for row, design, audited in read
            if design is not None
        ]
