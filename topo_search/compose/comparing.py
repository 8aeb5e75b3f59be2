"""Comparison of two runs, or of two designs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import nlp
from topo_search.compose.designs import audit, with_bound
from topo_search.model import BadInput, Design, Fault
from topo_search.model.files import read_json, write_atomically
from topo_search.study import RunFolder, answer_of

if TYPE_CHECKING:
    from topo_search.report.compare_page import Compared


def compare(first: str | Path, second: str | Path, *, out: str | Path | None = None) -> list[list[Compared]]:
    """Compare two runs, or designs, and return the designs of each, the best first.

    Args:
        first: a run's folder or a design's file.
        second: the other.
        out: where to write the page that shows them side by side; None for no page.

    Raises:
        BadInput: one of them is neither, or a run without a design.
        RuntimeError: the audit of a design failed; the message gives the reason.
    """
    from topo_search.report.compare_page import compare_page
    from topo_search.report.page import render

    sides = [_designs(Path(source)) for source in (first, second)]
    if out is not None:
        write_atomically(Path(out), render(compare_page(*sides)))
    return sides


def _designs(source: Path) -> list[Compared]:
    from topo_search.report.compare_page import Compared
    from topo_search.report.headline import rows_to_show

    if not source.is_dir():
        design = read_json(Design, source)
        design = with_bound(design, nlp.proven_bound(design.task))
        judged = audit(design)
        return [Compared(source.stem, design, judged, design.gap if judged.verdict == "clear" else None)]
    with RunFolder.load(source) as folder:
        answer = answer_of(folder).at_level
        if answer.shown is None:
            raise BadInput(str(source), [Fault("", "holds no design yet")])
        gaps = {size.modules: size.gap_of for size in answer.sizes}
        level = folder.levels[answer.level]
        read = ((row, *level.result_of(row)) for row in rows_to_show(answer, answer.shown))
        name = source.resolve().name
        return [
            Compared(f"{name}/{row.key}", design, audited, gaps[row.modules](row))
            for row, design, audited in read
            if design is not None
        ]
