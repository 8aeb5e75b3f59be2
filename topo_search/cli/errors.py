"""Errors with a message and an exit status of their own, in place of a traceback."""

from __future__ import annotations

import errno
import os
import signal
import sqlite3
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from typing import Any, NoReturn

import click

import topo_search as ts
from topo_search.supervisor import ExitStatus, Stop, is_out_of_memory


@contextmanager
def needs_extras(option: str) -> Iterator[None]:
    """Turn a missing library of an extra into how to install it."""
    extras = {"distributed": "cluster", "matplotlib": "viz", "mujoco": "sim", "PIL": "sim", "pyarrow": "viz"}
    try:
        yield
    except ModuleNotFoundError as error:
        extra = extras.get(error.name or "")
        if extra is None:
            raise
        how = f'needs {error.name}, which is not installed; run: pip install "topo-search[{extra}]"'
        raise ts.BadInput(option, how) from None


@contextmanager
def explain_errors(*, resumes: bool = False) -> Iterator[None]:
    """Turn what is wrong with the input, the machine or the user's patience into a message and an exit status.

    Ctrl-C, and the SIGTERM with which a scheduler ends a job, are the user's patience: the first of them raises
    KeyboardInterrupt here, and more of them change nothing.

    Args:
        resumes: whether the command keeps what it has finished, and goes on from there when it is typed again.
    """
    BadInput, WorkersLost, LedgerLost = ts.BadInput, ts.WorkersLost, ts.LedgerLost  # later memory may have run out
    kept = "; finished results are safe; run the same command to continue" if resumes else ""
    current = signal.getsignal(signal.SIGTERM)
    stop = current if isinstance(current, Stop) else Stop()
    before = stop.handle()
    stop.unwinds = True
    try:
        yield
    except KeyboardInterrupt as error:
        _end(_explain_stop(error), ExitStatus.INTERRUPTED)
    except Exception as error:
        if isinstance(error, LedgerLost):
            _end(str(error), ExitStatus.INPUT_OUTPUT)
        if stop.signalled:  # whoever was interrupted made another error of it
            _end(_explain_stop(error), ExitStatus.INTERRUPTED)
        if isinstance(error, BadInput):
            _end(str(error), ExitStatus.BAD_INPUT)
        if isinstance(error, WorkersLost):
            _end(f"{error}{kept}", ExitStatus.SOFTWARE)
        if is_out_of_memory(error):
            _end(f"out of memory{kept}", ExitStatus.OUT_OF_MEMORY)
        if isinstance(error, sqlite3.OperationalError):
            text = f"cannot write the ledger: {error}; its contents are safe; run the same command to continue"
            _end(text, ExitStatus.INPUT_OUTPUT)
        if isinstance(error, BrokenProcessPool) and isinstance(error.__cause__, OSError):
            error = error.__cause__  # what kept a worker from starting
        # an error without a number is no file's; with EPIPE the reader of our output left
        if isinstance(error, OSError) and error.errno not in (None, errno.EPIPE):
            where = f" ({error.filename})" if error.filename else ""
            _end(f"{os.strerror(error.errno)}{where}{kept}", ExitStatus.INPUT_OUTPUT)
        raise
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        stop.unwinds = False
        for number, handler in before.items():
            signal.signal(number, handler)


class Explained(click.Command):
    """A command whose errors `explain_errors` explains."""

    def __init__(self, *arguments: Any, resumes: bool = False, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self._resumes = resumes

    def invoke(self, ctx: click.Context) -> Any:
        """Run it."""
        with explain_errors(resumes=self._resumes):
            return super().invoke(ctx)


command = partial(click.command, cls=Explained)


def _explain_stop(error: BaseException) -> str:
    return "; ".join(("stopped", *getattr(error, "__notes__", ())))


def note(text: str) -> None:
    """Print a line on stderr beside the work, which goes on if nobody can be told."""
    try:
        click.echo(text, err=True)
    except OSError:
        return  # stderr is full, or its reader left


def _end(text: str, status: int) -> NoReturn:
    note(text)
    raise SystemExit(status)
