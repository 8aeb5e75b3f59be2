"""Errors with a message and an exit status of their own."""

from __future__ import annotations

import errno
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager

import click

BAD_INPUT = 2
INPUT_OUTPUT = 74
"""EX_IOERR of <sysexits.h>: the disk is full, or cannot be written to."""
INTERRUPTED = 130
"""128 + SIGINT, as shells have it."""


@contextmanager
def explained() -> Iterator[None]:
    """Turn what is wrong with the input, the disk or the user's patience into a message and an exit status."""
    from topo_search.model import BadInput

    try:
        yield
    except BadInput as error:
        _end(str(error), BAD_INPUT)
    except sqlite3.OperationalError as error:
        _end(
            f"the ledger cannot be written: {error}; what it holds is safe, and the same command resumes",
            INPUT_OUTPUT,
        )
    except OSError as error:
        if error.errno in (errno.EPIPE, None):  # the reader of our output went away, or no error of a file
            raise
        where = f" ({error.filename})" if error.filename else ""
        _end(
            f"{os.strerror(error.errno)}{where}; finished work is safe, and the same command resumes", INPUT_OUTPUT
        )


def _end(text: str, status: int) -> None:
    click.echo(text, err=True)
    raise SystemExit(status)
