"""Rows of measurements in a JSON-lines file, appended one by one, so that an interrupted run can resume."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

Row = dict[str, Any]


class Rows:
    """All rows of a file."""

    def __init__(self, path: Path) -> None:
        """Read the rows of the file, if it exists."""
        self._path = path
        self._rows: list[Row] = []
        if path.exists():
            self._rows = [json.loads(line) for line in path.read_text().splitlines()]

    def add(self, row: Row) -> None:
        """Append a row."""
        self._rows.append(row)
        with self._path.open("a") as file:
            file.write(json.dumps(row) + "\n")

    def where(self, **values: object) -> list[Row]:
        """Return the rows with these values."""
        return [row for row in self._rows if all(row.get(name) == value for name, value in values.items())]
