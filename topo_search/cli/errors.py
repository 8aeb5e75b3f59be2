"""Errors with a message and an exit status of their own, in place of a traceback."""

from __future__ import annotations

import errno
import os
import signal
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

import click

BAD_INPUT = 2
SOFTWARE = 70
"""EX_SOFTWARE of <sysexits.h>: there are no workers, here or at a Dask scheduler."""
INPUT_OUTPUT = 74
"""EX_IOERR of <sysexits.h>: the disk is full, or fails."""
INTERRUPTED = 130
"""128 + SIGINT, as shells have it."""


EXTRAS = {"distributed": "cluster", "matplotlib": "viz", "pyarrow": "viz"}
"""The extra that brings a library."""


@contextmanager
def needs_extras(option: str) -> Iterator[None]:
    """Turn a missing library of an extra into how to install it."""
    from topo_search.model import BadInput, Fault

    try:
        yield
    except ModuleNotFoundError as error:
        extra = EXTRAS.get(error.name or "")
        if extra is None:
            raise
        how = f'needs {error.name}, which is not installed; type: pip install "topo-search[{extra}]"'
        raise BadInput(option, [Fault("", how)]) from None


@contextmanager
def explained(*, resumes: bool = False) -> Iterator[None]:
    """Turn what is wrong with the input, the disk or the user's patience into a message and an exit status.

    Ctrl-C, and the SIGTERM with which a scheduler ends a job, are the user's patience.

    Args:
        resumes: whether the command keeps what it has finished, and goes on from there when it is typed again.
    """
    from topo_search.engine import WorkersLost
    from topo_search.model import BadInput

    kept = "; what the run has finished is safe, and the same command resumes it" if resumes else ""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    except BadInput as error:
        _end(str(error), BAD_INPUT)
    except KeyboardInterrupt:
        _end("stopped; all results are kept, and the same command resumes" if resumes else "stopped", INTERRUPTED)
    except WorkersLost as error:
        _end(f"{error}{kept}", SOFTWARE)
    except sqlite3.OperationalError as error:
        _end(
            f"the ledger cannot be written: {error}; what it holds is safe, and the same command resumes",
            INPUT_OUTPUT,
        )
    except OSError as error:
        if error.errno is None or error.errno == errno.EPIPE:  # no file's error; the reader of our output left
            raise
        where = f" ({error.filename})" if error.filename else ""
        _end(f"{os.strerror(error.errno)}{where}{kept}", INPUT_OUTPUT)
    finally:
        signal.signal(signal.SIGTERM, before)


def _end(text: str, status: int) -> NoReturn:
    click.echo(text, err=True)
    raise SystemExit(status)
