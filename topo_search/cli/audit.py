"""`topo-search audit`: the exact audit of designs, from their files alone: files, and folders of them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from topo_search.cli import options
from topo_search.cli.errors import explain_errors, note
from topo_search.limits import LIMITS
from topo_search.supervisor import ExitStatus

if TYPE_CHECKING:
    from topo_search.model import Geometry


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
        from topo_search.cli.tables import print_audit, print_tally
        from topo_search.compose import audits, available_cores
        from topo_search.engine import Failed
        from topo_search.export.audits import Judged, markdown
        from topo_search.model import Status
        from topo_search.model.files import write_atomically

        for option, out in (("--csv", table), ("--markdown", summary)):
            options.require_writable(out, option)
        files = design_files(designs)
        read: list[tuple[str, Geometry]] = []
        refused: list[tuple[str, str]] = []
        judged: list[Judged] = []
        failed: list[tuple[str, str]] = []
        apart = min(workers or available_cores(), len(files)) if len(files) > 1 else 0
        results = audits(_designs(files, read, refused), workers=apart)
        for number, result in enumerate(results):
            name, design = read[number]
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
            print_tally(verdicts, len(failed), len(refused), len(files) - len(read) - len(refused))
        if table is not None:
            from topo_search.export.audits import clearances_of, csv

            write_atomically(table, csv(clearances_of([(each.name, each.audit) for each in judged])))
        if summary is not None:
            write_atomically(summary, markdown(judged, [*failed, *refused]))
        if refused:
            raise SystemExit(ExitStatus.BAD_INPUT)
        if failed or any(each.audit.verdict != Status.CLEAR for each in judged):
            raise SystemExit(1)


AUDIT = "topo-search/audit"
"""`format` of an audit's file."""


@dataclass(frozen=True)
class DesignFile:
    """A file that is to hold a design."""

    path: str
    listed: bool = False
    """True if it was found in a folder, where it may be an audit that a run keeps beside its designs."""
    fault: str | None = None
    """Fault that was found before it was opened."""

    @property
    def name(self) -> str:
        """The path as it can be printed: Unicode without control characters."""
        from topo_search.model.value import to_printable

        return to_printable(self.path)

    def read(self) -> Geometry | None:
        """Return the design, or its geometry; None for an audit in a folder.

        Raises:
            BadInput: it is no design; names every fault.
        """
        from topo_search.model import BadInput
        from topo_search.model.files import load_json, stated_format, to_geometry

        if self.fault is not None:
            raise BadInput(self.name, self.fault)
        data = load_json(self.path, most_bytes=LIMITS.design_bytes)
        if self.listed and stated_format(data) == AUDIT:
            return None
        return to_geometry(data, self.name)


def _designs(
    files: Sequence[DesignFile], read: list[tuple[str, Geometry]], refused: list[tuple[str, str]]
) -> Iterator[Geometry]:
    """Yield the designs of files, in order, and tell the faults of files that hold none.

    Args:
        files: the files; audits in folders are passed over.
        read: gets every design with the name of its file.
        refused: gets every file that is wrong, with its faults.
    """
    from topo_search.model import BadInput

    for file in files:
        try:
            design = file.read()
        except BadInput as error:
            refused.append((file.name, "; ".join(map(str, error.faults))))
            note("\n".join(f"{file.name}: {fault}" for fault in error.faults))
            continue
        if design is not None:
            read.append((file.name, design))
            yield design


def design_files(words: Sequence[str]) -> list[DesignFile]:
    """Return the files of a command line in its order; of a folder all `*.json` below it, sorted.

    Links to folders are followed when they are given, not when they are met.
    """
    return [file for word in words for file in (_find_files(word) if Path(word).is_dir() else [DesignFile(word)])]


def _find_files(folder: str) -> Iterator[DesignFile]:
    unread: list[OSError] = []
    empty = True
    for parent, folders, files in os.walk(folder, onerror=unread.append):
        folders.sort()
        for name in sorted(files):
            if name.endswith(".json"):
                empty = False
                yield DesignFile(str(Path(parent) / name), listed=True)
    for error in unread:
        yield DesignFile(str(error.filename), fault=f"cannot be read: {error.strerror}")
    if empty and not unread:
        yield DesignFile(folder, fault="must contain designs, but no file below it ends in .json")
