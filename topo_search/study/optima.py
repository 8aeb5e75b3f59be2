"""Local optima besides the best design of each tree, of similar effort.

`optima/KEY-1.json`, `optima/KEY-2.json`, ... are the designs of a tree with a clear audit, lowest effort first.
`optima.json` records the search tree by tree, so that a stopped run resumes where it was.
"""

from dataclasses import replace
from functools import partial
from math import isclose
from typing import Literal

from topo_search.engine import Backends, Failed, Job
from topo_search.engine.workers import audit_deadline
from topo_search.model import LEAST_EFFORT, Design, Topology, Value
from topo_search.model.files import to_json
from topo_search.model.kinds import Index, Number
from topo_search.model.proof import Text
from topo_search.model.proven import TOLERANCE
from topo_search.study.directory import RunFile
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import Row, row_of
from topo_search.study.progress import solving_phase
from topo_search.study.request import Context
from topo_search.study.solving import Tools, audit_best


class TreeOptima(Value):
    """Record of the local optima of one tree."""

    context: Text
    """Digest of task, margin, seed and versions."""
    starts: Index
    """Number of starts of the search."""
    most_effort: Number
    """Largest effort of the search [rad^4/s^4]."""
    kept: Index
    """Number of designs with a clear audit, which are kept."""
    not_clear: Index
    """Number of designs without a clear audit, which are not kept."""

    def covers(self, context: Context, starts: int, most_effort: float) -> bool:
        """True if the search need not be repeated for these starts and this effort."""
        return self.context == context.name and self.starts >= starts and self.most_effort >= most_effort


class Optima(Value):
    """Record of the local optima of a run, as `optima.json` holds it."""

    format: Literal["topo-search/optima"] = "topo-search/optima"
    version: Literal[1] = 1
    trees: dict[Text, TreeOptima]
    """Records by the tree's key."""


def keep_optima(folder: RunFolder, n: int, tools: Tools, *, percent: float) -> None:
    """Find and keep every local optimum of n modules with a clear audit and an effort close to the best.

    Args:
        folder: the run's folder.
        n: number of modules.
        tools: solver, audit, engine, observer and time limit.
        percent: largest excess of the effort over that of the best design [%].
    """
    ledger, request = folder.ledger, folder.request
    contexts, best = request.contexts(n), ledger.best_clear(n)
    if best is None or best.objective is None or best.value is not None:  # optima of a value are none of effort
        return
    max_effort = (1 + percent / 100) * best.objective
    record = read_record(folder)
    rows = {row.key: row for row in ledger.ranking(n) if row.objective is not None and row.objective <= max_effort}
    jobs = list[Job]()
    for row in rows.values():
        context, tree = contexts[row.step], record.trees.get(row.key)
        if tree is not None and tree.covers(context, request.starts, max_effort):
            continue
        design = ledger.result(context, row.key)
        warm_starts = (design, *request.near) if isinstance(design, Design) else request.near
        topology = Topology.from_key(row.key)
        jobs.append(Job(context.task, topology, range(request.starts), context.seed, warm_starts, row.orbit))
    tools.observer.phase(solving_phase("polishing", contexts[0].task, len(jobs), request.starts))
    results = tools.engine.run(
        partial(_solve_and_audit, tools.backends, max_effort),
        jobs,
        deadline=lambda job: job.deadline + len(job.starts) * audit_deadline(n),
        until=tools.until,
    )
    is_improved = False
    for job, result in results:
        row = rows[job.topology.key]
        tools.observer.settled(best)
        if isinstance(result, Failed):
            tools.observer.note(f"{row.key}: its local optima are unknown, {result.reason}")
            continue
        clear = [design for design, is_clear in result if is_clear]
        is_improved |= _record_if_better(folder, row, clear)
        tree = record.trees.get(row.key)
        texts = [*map(to_json, clear), *[None] * ((tree.kept if tree else 0) - len(clear))]
        for k, text in enumerate(texts, start=1):
            folder.write_file(f"{RunFile.OPTIMA}/{row.key}-{k}.json", text)
        tree = TreeOptima(
            context=contexts[row.step].name,
            starts=request.starts,
            most_effort=max_effort,
            kept=len(clear),
            not_clear=len(result) - len(clear),
        )
        record = record.model_copy(update={"trees": {**record.trees, row.key: tree}})
        folder.write_file(RunFile.OPTIMA_RECORD, to_json(record))
    if is_improved:
        audit_best(folder, n, best.lower_bound or 0.0, tools)
    trees = [record.trees[key] for key in rows if key in record.trees]
    kept, not_clear = sum(tree.kept for tree in trees), sum(tree.not_clear for tree in trees)
    tools.observer.note(
        f"{n} modules: {kept} local optima of {len(trees)} trees within {percent:g} % of the best are in "
        f"{RunFile.OPTIMA}/" + (f"; {not_clear} more have no clear audit" if not_clear else "")
    )


def read_record(folder: RunFolder) -> Optima:
    """Return the record of the local optima of a run."""
    return folder.read_file(RunFile.OPTIMA_RECORD, Optima) or Optima(trees={})


def clear_designs(folder: RunFolder, row: Row) -> list[Design]:
    """Return a candidate's design if its audit is clear, and its other kept local optima."""
    context = folder.request.contexts(row.modules)[row.step]
    design, tree = folder.ledger.result(context, row.key), read_record(folder).trees.get(row.key)
    designs = [design] if row.clear and isinstance(design, Design) else []
    if tree is None or tree.context != context.name:
        return designs
    optima = (folder.read_file(f"{RunFile.OPTIMA}/{row.key}-{k}.json", Design) for k in range(1, tree.kept + 1))
    efforts = [design.objective for design in designs]
    new = (d for d in optima if d and not any(isclose(d.objective, J, rel_tol=TOLERANCE) for J in efforts))
    return [*designs, *new]


def _record_if_better(folder: RunFolder, row: Row, clear: list[Design]) -> bool:
    """Record the best optimum in the ledger if it costs less than its tree's design; return whether it does."""
    context = folder.request.contexts(row.modules)[row.step]
    recorded = folder.ledger.result(context, row.key)
    if not clear or not isinstance(recorded, Design) or clear[0].objective >= (1 - TOLERANCE) * recorded.objective:
        return False
    design = clear[0].model_copy(update={"solver": recorded.solver})
    better = row_of(design, row.key, row.modules, row.orbit, row.asked, row.lower_bound or 0.0, LEAST_EFFORT)
    folder.ledger.record(context, [(replace(better, margin=row.margin, step=row.step), design)])
    return True


def _solve_and_audit(backends: Backends, max_effort: float, job: Job) -> list[tuple[Design, bool]]:
    return [
        (design, backends.audit(design).verdict == "clear") for design in backends.local_optima(job, max_effort)
    ]
