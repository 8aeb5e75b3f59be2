"""TOML and JSON texts that anybody may have written, as data."""

from __future__ import annotations

import json
import re
import tomllib
from collections import Counter
from typing import Any

from topo_search.limits import KEY_PARTS, LISTS
from topo_search.model.bad_input import show

PART = r"""(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')"""
DOTTED = re.compile(rf"""(?<![A-Za-z0-9_."'-]){PART}(?:[ \t]*+\.[ \t]*+{PART}){{{KEY_PARTS}}}""")
"""A key of too many parts. The parser would take hours for it: its time grows with the cube of their number."""


class NotParsed(ValueError):
    """A text that is not what it is to be; says why."""

    def __init__(self, rule: str, *, beyond: bool = False) -> None:
        super().__init__(rule)
        self.beyond = beyond
        """Whether it is beyond a limit, and not read any further."""


def toml_data(text: str) -> dict[str, Any]:
    """Return the data of a TOML text.

    Raises:
        NotParsed: it is none, or has very many lists, brackets within each other or parts of a key.
    """
    if (lists := text.count("[")) > LISTS:
        raise NotParsed(f"must have at most {LISTS:,} lists, but has {lists:,}", beyond=True)
    if (dotted := DOTTED.search(text)) is not None:
        raise NotParsed(f"must have at most {KEY_PARTS} parts in a key, but got {show(dotted[0])}", beyond=True)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise NotParsed("must have fewer nested brackets", beyond=True) from None
    except ValueError as error:
        raise NotParsed(f"is not a TOML file, or only a part of one: {error}") from None


def json_data(text: str) -> Any:
    """Return the data of a JSON text, in which no name is given twice.

    Raises:
        NotParsed: it is none, or gives a name twice.
    """
    try:
        return json.loads(text, object_pairs_hook=_table)
    except NotParsed:
        raise
    except (ValueError, RecursionError) as error:
        raise NotParsed(f"is not a JSON file, or only a part of one: {error}") from None


def _table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Refuse a name that an object gives twice: which of the two values counts is anyone's guess."""
    table = dict(pairs)
    if len(table) < len(pairs):
        counts = Counter(name for name, _ in pairs)
        raise NotParsed(
            f"must give every name of an object once, but got {show(counts.most_common(1)[0][0])} twice"
        )
    return table
