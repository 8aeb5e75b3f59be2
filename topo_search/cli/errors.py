"""Error handling of commands: a message and an exit status instead of a traceback."""

import errno
import os
import signal
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, NoReturn

import click

import topo_search as ts
from topo_search.supervisor import ExitStatus, Stop


@contextmanager
def needs_extras(option: str) -> Iterator[None]:
    """Turn the error for a missing optional library into installation instructions."""
    extras = {"distributed": "cluster", "matplotlib": "viz", "mujoco": "sim", "PIL": "sim", "pyarrow": "viz"}
    try:
        yield
    except ModuleNotFoundError as error:
        extra = extras.get(error.name or "")
        if extra is None:
            raise
        rule = f'needs {error.name}, which is not installed; run: pip install "topo-search[{extra}]"'
        raise ts.BadInput(option, rule) from None


@contextmanager
def explain_errors(*, resumes: bool = False) -> Iterator[None]:
    """Turn bad input, failures of the machine and interrupts into a message and an exit status.

    The first Ctrl-C, or SIGTERM by which a scheduler ends a job, raises KeyboardInterrupt; later ones are ignored.

    Args:
        resumes: True if the same command, typed again, resumes from the results that are finished.
    """
    hint = "; finished results are safe; run the same command to continue" if resumes else ""
    current = signal.getsignal(signal.SIGTERM)
    stop = current if isinstance(current, Stop) else Stop()
    previous_handlers = stop.handle()
    stop.unwinds = True
    try:
        yield
    except KeyboardInterrupt as error:
        _exit(_explain_stop(error), ExitStatus.INTERRUPTED)
    except Exception as error:
        if isinstance(error, ts.LedgerLost):
            _exit(str(error), ExitStatus.INPUT_OUTPUT)
        if stop.signalled:  # code turned the interrupt into another error
            _exit(_explain_stop(error), ExitStatus.INTERRUPTED)
        if isinstance(error, ts.BadInput):
            _exit(str(error), ExitStatus.BAD_INPUT)
        if isinstance(error, ts.WorkersLost):
            _exit(f"{error}{hint}", ExitStatus.SOFTWARE)
        if isinstance(error, sqlite3.OperationalError):
            text = f"cannot write the ledger: {error}; its contents are safe; run the same command to continue"
            _exit(text, ExitStatus.INPUT_OUTPUT)
        # only errors of files have a number; EPIPE: the reader of our output has gone
        if isinstance(error, OSError) and error.errno not in (None, errno.EPIPE):
            file = f" ({error.filename})" if error.filename else ""
            _exit(f"{os.strerror(error.errno)}{file}{hint}", ExitStatus.INPUT_OUTPUT)
        raise
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        stop.unwinds = False
        for number, handler in previous_handlers.items():
            signal.signal(number, handler)


OPTION_GROUPS = {
    "Task": {"--modules", "--set", "--paper", "--topologies", "--near"},
    "Output": {"--out", "--live", "--json", "--csv", "--details", "--picture", "--page", "--video"},
    "Advanced": {"--symmetry", "--root", "--connectors", "--round", "--prune", "--keep-within", "--dask"},
}
"""Options below a title of their own in the help; all others are `Options`."""


class ExplainedCommand(click.Command):
    """A command with grouped options whose errors `explain_errors` explains."""

    def __init__(self, *arguments: Any, resumes: bool = False, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self._resumes = resumes

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write a section for each group of options that the command has."""
        sections: dict[str, list[tuple[str, str]]] = {title: [] for title in ("Options", *OPTION_GROUPS)}
        options = (parameter for parameter in self.get_params(ctx) if isinstance(parameter, click.Option))
        for parameter in options:
            if (record := parameter.get_help_record(ctx)) is not None:
                groups = (title for title, names in OPTION_GROUPS.items() if names & set(parameter.opts))
                sections[next(groups, "Options")].append(record)
        for title, records in sections.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command."""
        with explain_errors(resumes=self._resumes):
            return super().invoke(ctx)


command = partial(click.command, cls=ExplainedCommand)


def _explain_stop(error: BaseException) -> str:
    return "; ".join(("stopped", *getattr(error, "__notes__", ())))


def note(text: str) -> None:
    """Print a line on stderr; carry on if that fails."""
    try:
        click.echo(text, err=True)
    except OSError:
        return  # the disk is full, or the reader of stderr has gone


def _exit(text: str, status: int) -> NoReturn:
    note(text)
    raise SystemExit(status)
