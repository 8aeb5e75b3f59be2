"""Local optima of the trees of a run that cost little more than its best design: solved again, audited and kept.

`optima/KEY-1.json`, `optima/KEY-2.json`, ... are the designs of a tree whose audits are clear, least effort first.
`optima.json` says what was sought, tree by tree, so that a stopped run goes on where it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import isclose
from typing import Literal

from topo_search.engine import AuditDesign, Failed, Job, LocalOptima, audit_deadline
from topo_search.model import Design, Topology
from topo_search.model.files import to_json
from topo_search.model.proof import Text
from topo_search.model.tolerances import TOLERANCE
from topo_search.model.value import Index, Number, Value
from topo_search.study.directory import RunFile
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import Row, row_of
from topo_search.study.progress import Phase, solving_seconds
from topo_search.study.request import Context
from topo_search.study.solving import Tools, audit_best


class TreeOptima(Value):
    """Local optima of one tree."""

    context: Text
    """Digest of task, margin, seed and versions."""
    starts: Index
    """Number of starts that they were sought from."""
    most_effort: Number
    """Largest effort that was looked for [rad^4/s^4]."""
    kept: Index
    """Number of designs with a clear audit."""
    not_clear: Index
    """Number of designs whose audit is not clear; they are not kept."""

    def answers(self, context: Context, starts: int, most_effort: float) -> bool:
        """True if nothing is left to do for as many starts and as much effort."""
        return self.context == context.name and self.starts >= starts and self.most_effort >= most_effort


class Optima(Value):
    """Record of the local optima of a run, as `optima.json` holds it."""

    format: Literal["topo-search/optima"] = "topo-search/optima"
    version: Literal[1] = 1
    trees: dict[Text, TreeOptima]
    """By key."""


def keep_optima(folder: RunFolder, n: int, percent: float, tools: Tools) -> None:
    """Keep every local optimum of n modules that costs at most so much more than the best, and is clear.

    Args:
        folder: of the run.
        n: number of modules.
        percent: largest effort over that of the best design.
        tools: what solves and audits.
    """
    ledger, request = folder.ledger, folder.request
    contexts, best = request.contexts(n), ledger.best_clear(n)
    if best is None or best.objective is None:
        return
    most = (1 + percent / 100) * best.objective
    record = read_record(folder)
    rows = {row.key: row for row in ledger.ranking(n) if row.objective is not None and row.objective <= most}
    jobs = list[Job]()
    for row in rows.values():
        context, held = contexts[row.step], record.trees.get(row.key)
        if held is not None and held.answers(context, request.starts, most):
            continue
        design = ledger.result(context, row.key)
        near = (design, *request.near) if isinstance(design, Design) else request.near
        topology = Topology.from_key(row.key)
        jobs.append(Job(context.task, topology, row.orbit, range(request.starts), context.seed, near))
    seconds = solving_seconds(contexts[0].task, request.starts)
    tools.observer.phase(Phase("polishing", n, len(jobs), request.starts, seconds))
    solved = tools.engine.run(
        partial(_solve_and_audit, tools.backends.local_optima, tools.backends.audit, most),
        jobs,
        deadline=lambda job: job.deadline + len(job.starts) * audit_deadline(n),
        until=tools.until,
    )
    gained = False
    for job, result in solved:
        row = rows[job.topology.key]
        tools.observer.settled(best)
        if isinstance(result, Failed):
            tools.observer.note(f"{row.key}: its local optima are unknown, {result.reason}")
            continue
        clear = [design for design, is_clear in result if is_clear]
        gained |= _take_better(folder, row, clear)
        tree = TreeOptima(
            context=contexts[row.step].name,
            starts=request.starts,
            most_effort=most,
            kept=len(clear),
            not_clear=len(result) - len(clear),
        )
        record = _keep(folder, record, row.key, tree, clear)
    if gained:
        audit_best(folder, n, best.lower_bound or 0.0, tools)
    trees = [record.trees[key] for key in rows if key in record.trees]
    kept, not_clear = sum(tree.kept for tree in trees), sum(tree.not_clear for tree in trees)
    tools.observer.note(
        f"{n} modules: {kept} local optima of {len(trees)} trees within {percent:g} % of the best are in "
        f"{RunFile.OPTIMA}/" + (f"; {not_clear} more have no clear audit" if not_clear else "")
    )


def read_record(folder: RunFolder) -> Optima:
    """Return what is known of the local optima of a run."""
    return folder.read_own(RunFile.OPTIMA_RECORD, Optima) or Optima(trees={})


def clear_designs(folder: RunFolder, row: Row) -> list[Design]:
    """Return a candidate's design if its audit is clear, and its other local optima that are kept."""
    context = folder.request.contexts(row.modules)[row.step]
    design, held = folder.ledger.result(context, row.key), read_record(folder).trees.get(row.key)
    designs = [design] if row.clear and isinstance(design, Design) else []
    if held is None or held.context != context.name:
        return designs
    kept = (folder.read_own(f"{RunFile.OPTIMA}/{row.key}-{k}.json", Design) for k in range(1, held.kept + 1))
    known = [design.objective for design in designs]
    differ = (one for one in kept if one and not any(isclose(one.objective, J, rel_tol=TOLERANCE) for J in known))
    return [*designs, *differ]


def _keep(folder: RunFolder, record: Optima, key: str, tree: TreeOptima, designs: Sequence[Design]) -> Optima:
    """Write the designs of a tree, then the record, and return it."""
    before = record.trees.get(key)
    for k, design in enumerate(designs, start=1):
        folder.keep(f"{RunFile.OPTIMA}/{key}-{k}.json", to_json(design))
    for k in range(tree.kept + 1, (before.kept if before else 0) + 1):
        folder.drop(f"{RunFile.OPTIMA}/{key}-{k}.json")
    record = record.model_copy(update={"trees": {**record.trees, key: tree}})
    folder.keep(RunFile.OPTIMA_RECORD, to_json(record))
    return record


def _take_better(folder: RunFolder, row: Row, clear: list[Design]) -> bool:
    """Put an optimum that costs less than its tree's design into the ledger; return whether there was one."""
    context = folder.request.contexts(row.modules)[row.step]
    held = folder.ledger.result(context, row.key)
    if not clear or not isinstance(held, Design) or clear[0].objective >= (1 - TOLERANCE) * held.objective:
        return False
    design = clear[0].model_copy(update={"solver": held.solver})
    bound = row.lower_bound or 0.0
    better = row_of(design, key=row.key, modules=row.modules, orbit=row.orbit, starts=row.asked, lower_bound=bound)
    folder.ledger.record(context, [(replace(better, margin=row.margin, step=row.step), design)])
    return True


def _solve_and_audit(
    local_optima: LocalOptima, audit: AuditDesign, most: float, job: Job
) -> list[tuple[Design, bool]]:
    """Return the local optima of a tree, and whether the audit of each is clear (in a worker)."""
    optima = local_optima(job.task, job.topology, starts=job.starts, seed=job.seed, near=job.near, most_effort=most)
    return [(design, audit(design).verdict == "clear") for design in optima]
