"""Untrusted text as data: files of limited size, TOML and JSON; and tables as CSV."""

import csv
import io
import json
import os
import stat
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any


class NotReadable(ValueError):
    """File that is refused; the message names the rule and what was found."""


@dataclass(frozen=True)
class Folder:
    """Validation context that allows a task to name files: the folder that contains them."""

    path: Path


def read_regular(path: str | Path, *, most_bytes: int) -> bytes:
    """Return the content of a regular file.

    Args:
        path: file, or a link to one.
        most_bytes: largest size that is read.

    Raises:
        NotReadable: not a regular file, or too large.
        FileNotFoundError: there is no such file.
        OSError: the file cannot be opened or read.
    """
    status = os.stat(path)
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe or a device"
        raise NotReadable(f"must be a regular file, but is {kind}")
    if status.st_size > most_bytes:
        raise NotReadable(f"must have at most {most_bytes:,} bytes, but has {status.st_size:,}")
    return Path(path).read_bytes()


def read_text(path: str | Path, *, most_bytes: int) -> str:
    """Return the text of a regular file, without a byte order mark; see `read_regular`.

    NotReadable also names the first byte that is no text.
    """
    content = read_regular(path, most_bytes=most_bytes)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        i = error.start + len(content) - len(error.object)  # the codec drops the byte order mark
        raise NotReadable(f"must be UTF-8 text, but got the byte {content[i]:#04x} at offset {i}") from None


def toml_data(text: str) -> dict[str, Any]:
    """Return the data of a TOML text; ValueError if it is invalid."""
    try:
        return tomllib.loads(text)
    except (RecursionError, ValueError) as error:
        raise ValueError(f"is not a TOML file, or only a part of one: {error}") from None


def json_data(text: str) -> Any:
    """Return the data of a JSON text; ValueError if it is invalid."""
    try:
        return json.loads(text)
    except (RecursionError, ValueError) as error:
        raise ValueError(f"is not a JSON file, or only a part of one: {error}") from None


def csv_text(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table as the text of a CSV file."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()
