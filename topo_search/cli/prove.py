"""`topo-search prove`: a proof by branch and bound that no tree of a run beats its best design."""

from __future__ import annotations

import math
from pathlib import Path

import click

from topo_search.cli import options
from topo_search.cli.errors import explained, needs_extras, note
from topo_search.limits import SECONDS

OPEN = 4


@click.command(epilog="Example: topo-search prove runs/push-*/ --gap 0.01")
@click.argument("folder", metavar="RUN", type=click.Path(path_type=Path))
@click.option(
    "--gap",
    type=click.FloatRange(1e-4, 0.5),
    default=0.003,
    show_default=True,
    help="How far, as a share, the bound of a tree may stay under its own best effort where that is near the best.",
)
@click.option("--topology", metavar="KEY", help="The one tree to look at (default: all).")
@click.option(
    "--time-limit",
    type=click.FloatRange(0, SECONDS, min_open=True),
    metavar="SECONDS",
    help="Stop after this time with what is proven by then.",
)
@options.workers
@options.dask
@options.as_json
def prove(
    folder: Path,
    gap: float,
    topology: str | None,
    time_limit: float | None,
    workers: int | None,
    dask: str | None,
    dask_ca: Path | None,
    dask_cert: Path | None,
    dask_key: Path | None,
    as_json: bool,
) -> None:
    """Prove that no tree of a finished RUN can beat its best audited design, or by how little one can.

    Branch and bound over root orientation and hinges, with all load cases and torques. Proofs are in the run's
    folder, proof/KEY, and candidates.csv says of each tree: excluded (it cannot beat the best), within (its own
    best is proven to be as near as --gap), open, or impossible. The same command resumes a stopped one.

    Exit status: 0 all trees are excluded, within the gap or impossible; 4 some are open; 2 bad input;
    70 workers or the Dask scheduler do not start, answer or come back.
    """
    if dask is None and (dask_ca or dask_cert or dask_key):
        raise click.UsageError("--dask-ca, --dask-cert and --dask-key go with --dask")
    with explained(resumes=True):
        from topo_search.cli.progress import shown_progress
        from topo_search.compose import prove as prove_run
        from topo_search.study.frame import candidates

        with shown_progress() as observer, needs_extras("--dask"):
            answer = prove_run(
                folder,
                gap=gap,
                topology=topology,
                workers=workers,
                dask=dask,
                dask_tls=options.certificates(dask_ca, dask_cert, dask_key),
                time_limit=math.inf if time_limit is None else time_limit,
                observer=observer,
            )
        table = candidates(folder)
        looked_at = table if topology is None else table[table["key"] == topology]
        if as_json:
            names = ["key", "modules", "objective", "proven_bound", "proven_gap", "proof"]
            rows = looked_at[names].astype(object).where(looked_at[names].notna(), None).to_dict("records")
            options.echo_json({"sentences": [size.proven for size in answer.sizes], "candidates": rows})
        else:
            columns = (looked_at[name].tolist() for name in ("key", "proof", "proven_bound"))
            for key, proof, bound in zip(*columns, strict=True):
                by = f", J >= {bound:.6g} rad^4/s^4" if bound > 0 else ""
                click.echo(f"{key}: {proof if isinstance(proof, str) else 'not looked at'}{by}")
            for size in answer.sizes:
                if size.proven is not None:
                    click.echo(size.proven)
        settled = looked_at["proof"].isin(["excluded", "within", "impossible"]).all()
        if not settled:
            note("some trees are open; the same command goes on from there")
            raise SystemExit(OPEN)
