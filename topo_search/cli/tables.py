"""Tables and sentences that commands print."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path

from topo_search.engine import Failed, Outcome
from topo_search.export.audits import broken_lines, flight_lines, summary_lines
from topo_search.model import LEAST_EFFORT, Audit, Design, Infeasible, LargestValue, Objective, Status, objective_of
from topo_search.model.flying import DROPPED
from topo_search.model.proven import NOT_CERTIFIED, at_most, gap_percent, lower_text, upper_text
from topo_search.report.wording import fragile_margins, modules, quantity
from topo_search.study import Answer, Row, SizeAnswer, Solved

NO_CLEAR_ROD = ", without a straight rod that is clear of all parts and airflow"
"""End of a line about a design without such a rod."""


TEXTS = ("figure", "key", "tree", "audit", "run", "error", "first violation", "case", "scenario", "outcome")
"""Columns of text, which are left-aligned."""


def answer_lines(answer: Answer) -> Iterator[str]:
    """Yield the results of a run, its folder, and sentences about the best design."""
    yield from result_lines(answer)
    yield f"everything is in {answer.folder}"
    margins = ", ".join(fragile_margins(answer.audit, answer.design))
    fragile = f"fragile: {f'{DROPPED}; ' if answer.fragile else ''}{margins}" if margins else None
    remarks = (*answer.placement, *answer.air, answer.tolerances, answer.shorter_rod)
    for text in (fragile, answer.weakest_point, *remarks):
        if answer.best is not None and text is not None:
            yield f"{answer.best.key}: {text}"


def result_lines(answer: Answer) -> Iterator[str]:
    """Yield the results of a run."""
    if answer.levels:
        yield from _front(answer)
    else:
        yield from dict.fromkeys(size.quotient for size in answer.sizes)
        for size in answer.sizes:
            yield from _size(size)
    best = answer.best
    if best is not None:
        smallest = f", {answer.smallest}" if answer.smallest else ""
        line = f"best design: {best.key}, {modules(best.modules)}{smallest}"
        rod = "" if answer.clear_rod else NO_CLEAR_ROD
        if (note := answer.note) is not None:
            yield f"note on {best.key}: {note}"
        yield f"{line}, {_merit(answer.objective, best)}, audit {best.audit}{rod}"
        if answer.ability is not None:
            yield f"{best.key} {answer.ability}"
    elif answer.exit_status == 1:
        yield answer.failure
    else:
        yield "no design was found"


def _size(size: SizeAnswer) -> Iterator[str]:
    """Yield the table of one size."""
    yield _counts(size)
    if size.feasible:
        yield f"feasible trees, symmetric copies included: {size.feasible}"
        yield from _rows(size.top, size.objective)
    if len(size.near_ties) > 1:
        from topo_search.report.run_page import near_tie_table  # slow to import, and few answers need it

        caption, ties = near_tie_table(size)
        yield caption
        yield from table_lines(*ties[:2])
    if not size.complete:
        reached = f", after {quantity(size.starts, 'start')} of each candidate" if size.starts else ""
        yield f"not finished{reached}; run the same command to continue"
    if size.statement is not None and size.best is not None:
        yield f"{size.best.key} is {size.statement}"
    if size.proven is not None:
        yield size.proven
    yield from _remarks(size)


def _remarks(size: SizeAnswer) -> tuple[str, ...]:
    reasons = () if size.reason is None else (size.reason,)
    return (*size.remarks, *reasons, *(size.relaxed.sentences if size.relaxed else ()))


def _counts(size: SizeAnswer) -> str:
    text = f"{modules(size.modules)}: {size.settled} of {quantity(size.candidates, 'candidate')}"
    return f"{text} ({size.counts})" if size.counts else text


def _front(answer: Answer) -> Iterator[str]:
    """Yield the outcome of each level of the goals, and the front."""
    for outcome in answer.levels:
        yield f"level {outcome.number}: {outcome.level.words}"
        for size in outcome.sizes:
            yield f"  {_counts(size)}"
            if size.best is not None:
                yield f"  best {size.best.key}, {_merit(size.objective, size.best)}"
            if not size.complete:
                yield "  not finished; run the same command to continue"
            yield from (f"  {line}" for line in _remarks(size))
    if not answer.points:
        return
    from topo_search.report.run_page import front_designs

    yield f"front, {quantity(len(answer.points), 'design')}, none better than another in every goal:"
    yield from table_lines(*front_designs(answer.points, answer.objective)[:2])


def _rows(rows: tuple[Row, ...], objective: Objective) -> Iterator[str]:
    cells = []
    for row in rows:
        key, number, gap, audit = _summary_cells(row)
        beside = f"{at_most(row.objective / row.lower_bound, 3):.2f}" if row.objective and row.lower_bound else ""
        if row.value is not None:
            beside = f"{row.objective:.3g}"
        cells.append((key, number, beside, gap, f"{row.starts_at_best} of {row.starts}", str(row.orbit), audit))
    second = "J over bound" if objective.better == "less" else LEAST_EFFORT.column
    columns = "key", objective.column, second, "gap", "hits", "symmetric copies", "audit"
    return table_lines(columns, cells)


def _summary_cells(row: Row) -> tuple[str, str, str, str]:
    gap = "" if row.gap is None else gap_percent(row.gap)
    number = f"{row.objective:.3g}" if row.value is None else lower_text(row.value, 3)
    return row.key, number, gap, row.audit or ("failed" if row.audit_failure else "")


def run_lines(runs: Sequence[tuple[Path, Answer]]) -> Iterator[str]:
    """Return a table with a row for each run."""
    rows = []
    for path, answer in runs:
        sizes = ", ".join(str(size.modules) for size in answer.sizes)
        solved = f"{sum(size.settled for size in answer.sizes)} of {sum(size.candidates for size in answer.sizes)}"
        best, objective = answer.best, answer.objective
        cells = ["none", "", "", "", ""]
        if best is not None:
            value = objective.value_words(best) if isinstance(objective, LargestValue) else ""
            cells = [best.key, value, f"{best.objective:.3g}", *_summary_cells(best)[2:]]
        rows.append((str(path), sizes, solved, *cells))
    columns = "run", "modules", "candidates solved", "best", "largest", "J [rad^4/s^4]", "gap", "audit"
    kept = [k for k, name in enumerate(columns) if name != "largest" or any(row[k] for row in rows)]
    return table_lines([columns[k] for k in kept], [[row[k] for k in kept] for row in rows])


def table_lines(columns: Iterable[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    """Yield a table line by line."""
    from rich.console import Console  # slow to import, and most commands print no table
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for name in columns:
        table.add_column(name, justify="left" if name in TEXTS else "right")
    for row in rows:
        table.add_row(*row)
    console = Console(highlight=False, markup=False)  # rich would take units in brackets as markup
    if not console.is_terminal:
        console = Console(highlight=False, markup=False, width=120)
    with console.capture() as captured:
        console.print(table)
    yield from map(str.rstrip, captured.get().splitlines())


def _merit(objective: Objective, design: Row | Design) -> str:
    gap = "" if design.gap is None else f", gap to the {objective.bound} {gap_percent(design.gap)}"
    return f"{objective.words(design)}{gap}"


def progress_line(outcome: Outcome) -> str:
    """Return the state of one topology in a line."""
    if isinstance(outcome, Failed):
        return f"failed: {outcome.reason}"
    if isinstance(outcome, Infeasible):
        return outcome.message
    starts = (outcome.solver or {}).get("starts")
    text = _merit(objective_of(outcome.task), outcome)
    return text if starts is None else f"{text} after {quantity(starts, 'start')}"


def solved_lines(solved: Solved, out: Path | None) -> Iterator[str]:
    """Yield the outcome of one topology."""
    yield from solved.notes
    yield progress_line(solved.outcome)
    if isinstance(solved.outcome, Infeasible) and solved.outcome.relaxed:
        yield from solved.outcome.relaxed.sentences
    if isinstance(solved.outcome, Design):
        if isinstance(solved.audit, Audit):
            yield from audit_lines(solved.outcome.topology.key, solved.audit)
            sheet = solved.audit.assembly.end_effector
            if sheet is None or not sheet.clear_rod:
                yield f"{solved.outcome.topology.key}{NO_CLEAR_ROD}"
        if solved.found and (text := solved.outcome.shorter_rod) is not None:
            yield f"{solved.outcome.topology.key}: {text}"
        if out is not None:
            yield f"the design is in {out}"


def audit_lines(name: str, audit: Audit, *, details: bool = False) -> Iterator[str]:
    """Yield the verdict of an audit, what is not clear, and a summary; with `details` every figure."""
    yield f"{name}: {audit.verdict}, {quantity(len(audit.pairs), 'clearance')}"
    if audit.inputs_words is not None:
        yield f"  {audit.inputs_words}"
    overlaps = audit.interference
    if overlaps is not None and overlaps.colliding_pairs:
        sizes = ", ".join(str(len(cluster)) for cluster in overlaps.clusters)
        yield (
            f"  {quantity(overlaps.colliding_pairs, 'pair')} of envelopes overlap, in clusters of {sizes} modules; "
            f"the deepest by {upper_text(overlaps.deepest_percent, 3)} % of the deepest possible"
        )
    yield from (f"  {line}" for line in broken_lines(audit))
    for constraint in audit.stated:
        yield f"  {constraint.name} ({NOT_CERTIFIED}): {constraint.words}, bounds: {constraint.bounds}"
    yield from (f"  {line}" for line in summary_lines(audit))
    if details:
        from topo_search.report.design_part import errors, power

        notes = [f"note: {excess.words}" for excess in audit.mesh_excess]
        tolerances = () if audit.tolerances_words is None else (audit.tolerances_words,)
        flight = () if audit.flight is None else flight_lines(audit.flight)
        air = () if audit.air is None else audit.air.sentences()
        tables = (table_lines(*part[:2]) for part in (errors(audit), power(audit)) if part is not None)
        yield from (f"  {line}" for line in chain(notes, tolerances, flight, air, *tables))
    if audit.placement is not None:
        yield from (f"  note: {sentence}" for sentence in audit.placement.sentences())
    sheet = audit.assembly.end_effector
    if sheet is not None and sheet.note is not None:
        yield f"  note: {sheet.note}"


def tally_lines(verdicts: Sequence[Status], failed: int, refused: int, skipped: int) -> Iterator[str]:
    """Yield the number of designs by verdict, over all files of a command."""
    counts = {**Counter(map(str, verdicts)), "failed": failed, "bad input": refused}
    text = ", ".join(f"{number} {verdict}" for verdict, number in counts.items() if number)
    yield f"{quantity(len(verdicts) + failed, 'design')}: {text or 'none'}"
    if skipped:
        yield f"{quantity(skipped, 'audit')} in the folders skipped"
