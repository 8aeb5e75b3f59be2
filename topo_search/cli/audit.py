"""`topo-search audit`: the exact audit of designs, from their files alone."""

from __future__ import annotations

from pathlib import Path

import click

from topo_search.cli import options
from topo_search.cli.errors import BAD_INPUT, explain_errors, note


@click.command(epilog="Example: topo-search audit runs/push-*/best.json --markdown audit.md")
@click.argument("designs", nargs=-1, required=True, metavar="DESIGN.json|FOLDER...")
@options.as_json
@options.out("--csv", "table", "Write all clearances to a CSV table.")
@options.out("--markdown", "summary", "Write a summary in Markdown.")
@options.workers
def audit(
    designs: tuple[str, ...], as_json: bool, table: Path | None, summary: Path | None, workers: int | None
) -> None:
    """Audit designs exactly, from the design files alone.

    Given a folder, every .json file below it is audited; audits in a run's folder are skipped.

    Exit status: 0 all clear; 1 a design is violated, undecided or inconsistent, or its audit failed;
    2 a file cannot be read or is not a design (the others are still audited).
    """
    with explain_errors():
        from topo_search.cli.design_files import Reading, design_files
        from topo_search.cli.tables import print_audit, print_tally
        from topo_search.compose import audits, available_cores
        from topo_search.engine import Failed
        from topo_search.export.audits import Judged, markdown
        from topo_search.model import Status
        from topo_search.model.files import write_atomically

        for option, out in (("--csv", table), ("--markdown", summary)):
            options.require_writable(out, option)
        files = design_files(designs)
        reading = Reading(files, tell=note)
        judged: list[Judged] = []
        failed: list[tuple[str, str]] = []
        apart = min(workers or available_cores(), len(files)) if len(files) > 1 else 0
        results = audits(reading.designs(), workers=apart)
        for number, result in enumerate(results):
            name, design = reading.read[number]
            if isinstance(result, Failed):
                failed.append((name, f"the audit failed: {result.reason}"))
                note(": ".join(failed[-1]))
                continue
            judged.append(Judged(name, design, result))
            if not as_json:
                print_audit(name, result)
        if as_json:
            values = [{"file": each.name, **each.audit.model_dump(mode="json")} for each in judged]
            alone = len(designs) == 1 and not files[0].listed and values
            options.echo_json(values[0] if alone else values)
        elif len(files) > 1:
            verdicts = [each.audit.verdict for each in judged]
            print_tally(verdicts, len(failed), len(reading.refused), reading.passed_over)
        if table is not None:
            from topo_search.export.audits import clearances_of, csv

            write_atomically(table, csv(clearances_of([(each.name, each.audit) for each in judged])))
        if summary is not None:
            write_atomically(summary, markdown(judged, [*failed, *reading.refused]))
        if reading.refused:
            raise SystemExit(BAD_INPUT)
        if failed or any(each.audit.verdict != Status.CLEAR for each in judged):
            raise SystemExit(1)
