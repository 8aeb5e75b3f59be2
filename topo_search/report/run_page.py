"""The page of a run, made from the run's folder."""

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby, islice
from typing import Any

import verify
from topo_search.export.audits import broken_lines
from topo_search.export.poses import poses_to_draw
from topo_search.limits import quantity
from topo_search.model import Audit, BadInput, Design, Geometry, Infeasible, LargestValue, Objective
from topo_search.model.flying import DROPPED
from topo_search.model.proven import NOT_CERTIFIED, gap_percent, lower_text, upper_text
from topo_search.report import Table, Tile
from topo_search.report.charts import AXES, front_chart, length_or_none, progress
from topo_search.report.design_page import bound
from topo_search.report.headline import cards, compared_designs, headline, ranking
from topo_search.report.page import render
from topo_search.report.polytope import polytopes
from topo_search.report.wording import (
    figures,
    modules,
    near_tie_cells,
    near_tie_columns,
    rounded_down,
    rounded_up,
    sentence,
)
from topo_search.study import NEAR_BEST, Answer, FrontPoint, Row, RunFile, RunFolder, SizeAnswer, answer_of
from topo_search.study.columns import kind_of
from topo_search.study.proofs import candidates_of
from topo_search.study.request import NO_INPUTS, UserInputs


def write_run_page(folder: RunFolder) -> None:
    """Write `report.html` into a run's folder."""
    folder.write_file(RunFile.REPORT, render(run_page(folder)) + folder.page_mark())


def run_page(folder: RunFolder) -> dict[str, Any]:
    """Return the page of a run."""
    answer, goals = answer_of(folder), folder.request.task.goals
    if not answer.levels:
        return _page(folder, answer)
    page = _page(folder.levels[answer.level], answer.at_level)
    words = answer.levels[answer.level].level.words
    note = f"Everything on this page except the front refers to level {answer.level} of the goals: {words}."
    return {
        **page,
        "notes": (note, *page["notes"]),
        "front": front_part(answer, goals.names),
        "reproduction": _reproduction(folder),
    }


def _page(folder: RunFolder, answer: Answer) -> dict[str, Any]:
    """Return the page of a run without goals, or of one level of a run with goals."""
    request = folder.request
    shown = answer.shown
    n = shown.modules if shown else request.task.sizes[0]
    size = next(size for size in answer.sizes if size.modules == n)
    design, audit = (None, None) if shown is None else folder.result_of(shown)
    tiles: tuple[Tile, ...] = ()
    if design is not None and shown is not None:
        compared = f"{quantity(sum(size.settled for size in answer.sizes), 'candidate')} solved"
        tiles = (*headline(design, audit, size.gap_of(shown), compared, scoped=size.proven_gap is not None),)
    return {
        "title": f"{request.task.name}: {modules(n) if shown else _no_design(answer)}",
        "key": shown.key if shown else None,
        "answer": _answer(answer, request.task.name, shown, size) + f" {sentence(DROPPED)}" * bool(answer.fragile),
        "sizes": () if shown else tuple(f"{modules(size.modules)}: {size.reason}." for size in answer.sizes),
        "advice": tuple(
            f"{modules(size.modules)}: {advice}."
            for size in answer.sizes
            for advice in (size.relaxed.advice if size.relaxed else ())
        ),
        "miss": None if shown else _miss(folder),
        "tiles": tiles,
        "notes": (
            *_user_inputs(request.user_inputs),
            *map(sentence, dict.fromkeys(size.quotient for size in answer.sizes)),
            *(note for size in answer.sizes for note in _size_notes(size, shown)),
        ),
        "bound": (
            *bound(size.lower_bound, shown.gap if shown else None, request.task.resolve(n), size.value_bound),
            *(sentence(proven) for size in answer.sizes if (proven := size.proven) is not None),
        ),
        "bounded": size.objective.bound,
        "polytopes": None if design is None else polytopes([(design, audit), *_runner_up(folder, size, design)]),
        "task": request.task.resolve(n),
        "user_task": request.task,
        "design": design,
        "audit": audit,
        "run": _run_part(folder, answer, shown),
        "reproduction": _reproduction(folder),
    }


def _no_design(answer: Answer) -> str:
    """Return that there is no design, with the sizes that were asked for."""
    yet = "" if answer.complete else " yet"
    first, *others = (size.modules for size in answer.sizes)
    if not others:
        return f"no design{yet} with {modules(first)}"
    return f"no design{yet} with {first} {'to' if len(others) > 1 else 'or'} {modules(others[-1])}"


def _miss(folder: RunFolder) -> dict[str, Any] | None:
    """Return the platform that came closest to a design, with what it misses; None if it cannot be drawn."""
    closest = folder.read_file(RunFile.CLOSEST, Geometry)
    audit = folder.read_file(RunFile.CLOSEST_AUDIT, Audit)
    if closest is None or audit is None:
        return None
    design, most = verify.complete(closest), 8  # lines
    try:
        poses_to_draw(design)
    except BadInput:  # its end-effector is too far away
        return None
    return {"design": design, "audit": audit, "lines": tuple(islice(broken_lines(audit), most))}


def _answer(answer: Answer, name: str, shown: Row | None, size: SizeAnswer) -> str:
    """Return the answer in one sentence."""
    if answer.best is None and not answer.complete:
        solved, candidates = (
            sum(getattr(one, field) for one in answer.sizes) for field in ("settled", "candidates")
        )
        return f"No audited design for {name} yet: {solved} of {quantity(candidates, 'candidate')} solved."
    if shown is None:
        return f"No design was found for {name}."
    has = f"{shown.key} {'needs' if shown.value is None else 'has'} the {size.objective.least}"
    if answer.best is None:
        return f"No design found for {name} passed its audit; {has}."
    if answer.levels:
        return f"Of {quantity(len(answer.points), 'design')} on the front, {has}."
    smallest = f"With {modules(shown.modules)}, {answer.smallest}, " if answer.smallest else ""
    held = "" if answer.ability is None else f"{answer.ability} and "
    return f"{smallest}{shown.key} {held}is {size.statement}."


def _size_notes(size: SizeAnswer, shown: Row | None) -> list[str]:
    """Return notes on the answer for one size beyond the headline."""
    sentences = []
    if size.statement is not None and size.best is not None and size.best != shown:
        sentences.append(f"{modules(size.modules)}: {size.best.key} is {size.statement}.")
    if not size.complete:
        reached = f" after {quantity(size.starts, 'start')} per candidate" if size.starts else ""
        sentences.append(
            f"{modules(size.modules)}: the search was stopped{reached}, with {size.settled} of {size.candidates} "
            "candidates solved; run the same command again to continue."
        )
    return sentences


def _user_inputs(user_inputs: UserInputs) -> Iterator[str]:
    """Yield notes on what the user supplied besides the task."""
    if user_inputs.constraints:
        names = ", ".join(f"{constraint.name} ({constraint.bounds})" for constraint in user_inputs.constraints)
        yield f"{NOT_CERTIFIED.capitalize()}: {names}. Lower bounds and proofs ignore this and remain valid."
    if user_inputs.topologies is not None:
        yield f"The candidates are {quantity(len(user_inputs.topologies), 'tree')} listed by the user."
    if user_inputs.near:
        yield f"Candidates were also started from {quantity(len(user_inputs.near), 'design')} supplied by the user."
    if user_inputs.sampler is not None:
        yield f"Candidates were proposed by the user's sampler {user_inputs.sampler.name}."


def _run_part(folder: RunFolder, answer: Answer, shown: Row | None) -> dict[str, Any]:
    candidates = [candidate for size in answer.sizes for candidate in candidates_of(folder, size.modules)]
    rows = [row for row, *_ in candidates]
    charts = []
    for size in answer.sizes:
        solves = list(folder.ledger.solves(size.modules))
        limit = size.lower_bound if size.value_bound is None else size.value_bound
        if solves and limit > 0:
            caption = f"{modules(size.modules)}: {quantity(len(solves), 'solve')}"
            charts.append((f"progress-{size.modules}", caption, progress(solves, size.objective, limit)))
    return {
        "sizes": _sizes(answer),
        "near_ties": tuple(near_tie_table(size) for size in answer.sizes if len(size.near_ties) > 1),
        "least": answer.objective.least,
        "asked": folder.request.strategy == "randomized",
        **ranking(candidates, answer.objective, proofs=any(size.proven is not None for size in answer.sizes)),
        "cards": () if shown is None else tuple(cards(compared_designs(folder, answer), shown)),
        "progress": tuple(charts),
        "reasons": _missed_constraints(folder, rows),
        "remarks": tuple(remark for size in answer.sizes for remark in size.remarks),
        "relaxed": tuple(part for size in answer.sizes if (part := relaxed_limits(size)) is not None),
    }


def _sizes(answer: Answer) -> Table:
    rows = [
        {
            "modules": str(size.modules),
            "candidates solved": f"{size.settled} of {size.candidates}",
            "statuses": size.counts,
            "feasible trees, symmetric copies included": str(size.feasible),
            **_bound_cell(size),
            "best": size.best.key if size.best else "none",
            **_numbers(size),
            "gap": gap_percent(size.best.gap) if size.best and size.best.gap is not None else "",
        }
        for size in answer.sizes
    ]
    return Table.from_rows(rows, {0, 3, 4, *range(6, len(rows[0]))})


def _runner_up(folder: RunFolder, size: SizeAnswer, best: Design) -> Iterator[tuple[Design, Audit | None]]:
    """Yield the next best audited design of a size with its audit, if there is one."""
    others = (row for row in size.top if row.clear and row.value and row.key != best.topology.key)
    for row in islice(others, 1):
        design, audit = folder.result_of(row)
        if design is not None:
            yield design, audit


def _bound_cell(size: SizeAnswer) -> dict[str, str]:
    if isinstance(size.objective, LargestValue):
        return {f"upper bound [{size.objective.quantity.unit}]": rounded_up(size.value_bound, digits=5)}
    return {"lower bound [rad⁴/s⁴]": rounded_down(size.lower_bound, digits=5)}


def near_tie_table(size: SizeAnswer) -> tuple[str, Table]:
    """Return caption and table of the designs of one size that are about as good as the best."""
    best = size.best or size.near_ties[0]
    text = f"{modules(size.modules)}: audited designs within {100 * NEAR_BEST:g} % of the {size.objective.least}, "
    text += "largest force reserve in hover first"
    if size.near_ties_unaudited:
        text += f"; {quantity(size.near_ties_unaudited, 'more design')} within that were not audited"
    cells = [near_tie_cells(row, size.objective.difference(row, best), size.rotors) for row in size.near_ties]
    columns = near_tie_columns(size.objective)
    return text, Table(columns, cells, range(1, len(columns)))


def _missed_constraints(folder: RunFolder, rows: Iterable[Row]) -> Table | None:
    """Count the constraints that the least violated start of each infeasible candidate violates most.

    The table also gives the candidate with the smallest violation.
    """

    def group(row: Row) -> tuple[int, str, str]:
        return row.modules, row.status, kind_of(row.worst_constraint or "")

    not_feasible = sorted((row for row in rows if not row.feasible), key=group)
    groups = [(*key, list(members)) for key, members in groupby(not_feasible, key=group)]
    cells = []
    for n, status, kind, members in sorted(groups, key=lambda entry: (entry[0], -len(entry[3]))):
        closest = min(members, key=lambda row: math.inf if row.violation is None else row.violation)
        violation = "" if closest.violation is None else f"{rounded_down(closest.violation)} {closest.unit or ''}"
        result = folder.ledger.result(folder.request.contexts(n)[closest.step], closest.key)
        row = {
            "modules": str(n),
            "status": status,
            "worst constraint": kind,
            "candidates": str(len(members)),
            "smallest violation": violation,
            "in tree": closest.key,
            "message": result.message if isinstance(result, Infeasible) else "",
        }
        cells.append(row)
    return Table.from_rows(cells, {0, 3, 4}) if cells else None


def _reproduction(folder: RunFolder) -> dict[str, Any]:
    request = folder.request.asked or folder.request
    search = f"--strategy {request.strategy} --symmetry {request.symmetry}"
    options = f"{search} --starts {request.starts} --seed {request.seed}"
    if request.strategy == "optuna":
        trials = request.trials or max(request.space(n).count() for n in request.task.sizes)
        sampler = "" if request.user_inputs.sampler is not None else f" --sampler {request.sampler}"
        options += f"{sampler} --trials {trials} --round {request.round_size}"
    elif request.prune:
        options += " --prune"
    notes: tuple[str, ...] = (
        f"task.toml is in the run's folder, and below. Seed {request.seed} determines the random starts; the "
        "number of workers only affects the computing time.",
    )
    if request.user_inputs != NO_INPUTS:
        lead = "The command does not include what the user supplied: "
        notes = (*notes, lead + " ".join(_user_inputs(request.user_inputs)))
    return {
        "commands": (f"topo-search run task.toml {options}",),
        "task": request.task,
        "versions": request.versions,
        "notes": notes,
    }


def front_part(answer: Answer, names: Sequence[str]) -> dict[str, Any]:
    """Return the section on the Pareto front.

    Args:
        answer: the answer of a run with goals.
        names: the names of its goals.
    """
    objective = answer.objective
    number, efforts = ("J", ()) if objective.better == "less" else (objective.number_words, ("objective",))
    charts = [
        (
            f"front-{name.replace('_', '-')}",
            f"{number} against {AXES[name][0]}",
            front_chart(answer.points, name, objective),
        )
        for name in (*names, *efforts)
        if any(point.cells[name] is not None for point in answer.points)
    ]
    return {"charts": charts, "designs": front_designs(answer.points, objective), "levels": _levels(answer)}


def front_designs(points: Sequence[FrontPoint], objective: Objective) -> Table:
    """Return the designs of a front with what they reach, best first."""
    lowest_J = min((point.row.objective or 0.0 for point in points), default=None)
    rows = [
        [
            point.row.key,
            str(point.row.modules),
            figures(point.row.objective or 0.0, 5),
            f"{(point.row.objective or 0.0) / lowest_J:.4f}" if lowest_J else "",
            length_or_none(point.clearance),
            length_or_none(point.stand_off),
            upper_text(point.peak_input, 4),
            str(point.number),
            point.row.audit or "",
            *([] if point.row.value is None else [lower_text(point.row.value, 4)]),
        ]
        for point in points
    ]
    reached = ("smallest clearance", "stand-off", "largest input / u_max")
    columns = ("tree", "modules", "J [rad⁴/s⁴]", "J over lowest J", *reached, "level", "audit")
    value = () if objective.better == "less" else (objective.column,)
    return Table((*columns, *value), rows, {*range(1, 8), 9})


def _levels(answer: Answer) -> Table:
    """Return a row for every level and size, with the reason if no design was found."""
    on_front = [point.number for point in answer.points]
    rows = [
        {
            "level": str(level_answer.number),
            "limits": level_answer.level.words,
            "modules": str(size.modules),
            "candidates": size.counts,
            "best tree": size.best.key if size.best else "none",
            **_numbers(size),
            "on the front": quantity(on_front.count(level_answer.number), "design"),
            "reason": size.reason or "",
        }
        for level_answer in answer.levels
        for size in level_answer.sizes
    ]
    return Table.from_rows(rows, {0, 2, 5})


def _numbers(size: SizeAnswer) -> dict[str, str]:
    """Return what the best design of a size has of the objective, and its effort."""
    row, value = size.best, {}
    if size.objective.better == "more":
        value = {size.objective.column: rounded_down(row.value if row else None, digits=5)}
    return {**value, "J [rad⁴/s⁴]": figures(row.objective, 5) if row and row.objective is not None else ""}


def relaxed_limits(size: SizeAnswer) -> tuple[str, Table] | None:
    """Return the limits that were relaxed for a size without a design; None if nothing was tried."""
    relaxed = size.relaxed
    if relaxed is None or not relaxed.sentences:
        return None
    rows = [
        [
            relaxation.settings,
            f"design of {relaxation.topology_key}",
            "" if relaxation.not_enough is None else f"{100 * relaxation.not_enough:.3g} %",
        ]
        for relaxation in relaxed.relaxations
    ]
    rows += [[text, "none found", ""] for text in relaxed.in_vain]
    rows += [[text, "could not be tried", ""] for text in relaxed.untried]
    caption = f"{modules(size.modules)}: the task's limits, relaxed and solved again; not a proof"
    return caption, Table(("change", "result", "insufficient"), rows)
