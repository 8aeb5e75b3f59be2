"""`topo-search solve`: solve one topology; `prove`: prove that no tree of a run beats its best design."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import topo_search as ts
from topo_search.cli import options
from topo_search.cli.errors import command, explain_errors, needs_extras, note
from topo_search.limits import LIMITS
from topo_search.supervisor import ExitStatus

if TYPE_CHECKING:
    from topo_search.model.objective import Objective


@command(epilog="Example: topo-search solve push --topology af0000 --out design.json")
@click.argument("task")
@click.option(
    "--topology", "key", metavar="KEY", required=True, help="The topology, as `topo-search topologies` prints it."
)
@options.set_field
@options.paper
@options.starts("Number of starts (default: until more starts no longer help, or time is up).")
@options.seed
@options.time_limit()
@options.near
@click.option("--out", type=options.FILE, help="Output file for the design.")
@options.as_json
def solve(
    task: str,
    key: str,
    settings: tuple[str, ...],
    paper: bool,
    near: tuple[str, ...],
    out: Path | None,
    **option_values: Any,
) -> None:
    """Solve TASK for one topology and audit the design.

    Without --starts and --time-limit it stops when more starts no longer help. Warnings about the task (see
    `check`) go to stderr first.

    --json prints the design, or why there is none. If --out cannot be written, the design is printed instead, so
    nothing is lost. Exit status as for `run`.
    """
    from topo_search.cli.tables import progress_line, solved_lines
    from topo_search.engine import Failed
    from topo_search.model.files import write_atomically
    from topo_search.model.value import as_bad_input

    problem = options.task_of(task, settings, paper=paper)
    with as_bad_input("--topology"):
        topology = ts.Topology.from_key(key)
    designs = options.read_near(near)
    options.require_writable(out)
    options.warn(problem.model_copy(update={"modules": topology.n}))
    solved = ts.solve(
        problem, topology, near=designs, progress=lambda best: note(progress_line(best)), note=note, **option_values
    )
    if out is not None and isinstance(solved.outcome, ts.Design):
        text = ts.to_json(solved.outcome)
        try:
            write_atomically(out, text)
        except OSError:
            click.echo(text, nl=False)  # so that the design is not lost
            raise
    lines = solved_lines(solved, out)
    if isinstance(solved.outcome, Failed):
        options.echo_answer({"status": "failed", "reason": solved.outcome.reason}, lines)
    else:
        options.echo_lines([ts.to_json(solved.outcome).rstrip("\n")] if options.is_json() else lines)
    raise SystemExit(solved.exit_status)


@command(epilog="Example: topo-search prove runs/push-*/ --gap 0.01", resumes=True)
@click.argument("folder", metavar="RUN", type=options.PATH)
@options.real_number(
    "--gap",
    LIMITS.gaps,
    "Relative gap at which a tree counts as settled: how far its bound may lie below its own best effort.",
    default=0.003,
)
@options.choice(
    "--problem",
    ["task", "solver"],
    "Designs that the proof covers: all that the audit may call clear, or those that also keep the solver's "
    "margin and distance between centres.",
    default="task",
)
@click.option("--topology", metavar="KEY", help="Prove only this tree (default: all).")
@click.option(
    "--from",
    "lender",
    metavar="RUN",
    type=options.PATH,
    help="Reuse complete proofs of another run where they suffice for --gap; its task may differ only in name "
    "and exposure.",
)
@options.time_limit("Stop after this time and keep the proofs so far.")
@options.flag("--check", "Only check the proofs in RUN, with code that shares nothing with the prover.", "checks")
@options.workers
@options.dask
@options.as_json
def prove(folder: Path, topology: str | None, checks: bool, **option_values: Any) -> None:
    """Prove that no tree of a finished RUN beats its best audited design, or bound by how much one could.

    Branch and bound over root orientation and hinge angles, with all load cases and torques. Proofs are written to
    proof/KEY in the run's folder; candidates.csv gets one result per tree: excluded (it cannot beat the best),
    within (its own best is proven to within --gap), open, or impossible. Run the same command to resume.

    With --check, every record is replayed box by box, and every box is excluded again with the checker's own
    multipliers, bounds and geometry. A proof that fails is refused, with the box where it fails.

    Exit status: 0 all trees are excluded, within the gap or impossible (with --check: and their proofs hold);
    4 some are open; 1 the checker refuses a proof; 2 bad input;
    70 workers or the Dask scheduler do not start, answer or return.
    """
    if checks:
        for name, option in (("--time-limit", "time_limit"), ("--from", "lender")):
            if option_values[option] is not None:
                raise click.UsageError(f"{name} cannot be combined with --check")
        engine = {name: option_values[name] for name in ("workers", "dask")}
        _check(folder, topology=topology, **engine)
        return
    from topo_search.report.shown import visible_progress

    with visible_progress(tell=note) as observer, needs_extras("--dask"):
        answer = ts.prove(folder, topology=topology, observer=observer, **options.without_none(option_values))
    from topo_search.study.tables import candidates

    table = candidates(folder)
    table = table if topology is None else table[table["key"] == topology]
    names = ["key", "modules", "objective", "proven_bound", "proven_gap", "proof", "proven_problem"]
    rows = table[names].astype(object).where(table[names].notna(), None).to_dict("records")
    sentences = [size.proven for size in answer.sizes]
    lines = [
        _proof_line(row["key"], row["proof"] or "not examined", row["proven_bound"] or None, answer.objective)
        for row in rows
    ]
    value = {"sentences": sentences, "candidates": rows}
    options.echo_answer(value, (*lines, *(text for text in sentences if text is not None)))
    settled = table["proof"].isin(["excluded", "within", "impossible"]).all()
    settled &= not any(topology in (None, key) for size in answer.sizes for key in size.proof_open)
    if not settled or (topology is None and not answer.proven):
        resumable = any(topology in (None, key) for size in answer.sizes for key in size.proof_resumable)
        note("some trees are still open" + "; run the same command to continue" * resumable)
        raise SystemExit(ExitStatus.OPEN)


def _proof_line(key: str, verdict: str, bound: float | None, objective: Objective, fault: str | None = None) -> str:
    claim = "" if bound is None else f", {objective.claim(bound)}"
    return f"{key}: {verdict}{claim}" + (f": {fault}" if fault else "")


def _check(folder: Path, **option_values: Any) -> None:
    """Check the proofs of a run, print the result and exit with its status."""
    with explain_errors():
        from topo_search.compose import check_proofs
        from topo_search.report.shown import visible_progress

        with visible_progress(tell=note) as observer, needs_extras("--dask"):
            result = check_proofs(folder, observer=observer, **option_values)
    trees = [{"key": tree.key, "verdict": tree.verdict} | asdict(tree) for tree in result.trees]
    refused = [f"refused: {fault}" for fault in result.faults]
    lines = [_proof_line(tree.key, tree.verdict, tree.bound, result.objective, tree.fault) for tree in result.trees]
    value = {"sentences": result.sentences, "faults": result.faults, "trees": trees}
    options.echo_answer(value, (*refused, *lines, *result.sentences))
    if result.refused:
        raise SystemExit(1)
    if not result.settled:
        note("some trees are still open; run `topo-search prove` to continue")
        raise SystemExit(ExitStatus.OPEN)
