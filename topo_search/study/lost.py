"""What a run says when its folder or ledger vanishes while it works."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from topo_search.model import Design
    from topo_search.study.answer import Answer


KEPT = "all results are kept; run the same command to continue"
"""Note (PEP 678) of what ends a run early, once it is so."""


class LedgerLost(Exception):
    """The ledger, or its folder, was removed, moved, replaced or emptied while a run worked in it."""

    def __init__(self, path: Path) -> None:
        self.answer: Answer | None = None
        """What the run had found, as far as it can still be read."""
        self.design: Design | None = None
        """The best design, audited if any is: nothing else may hold it any more."""
        super().__init__(
            f"{path}: was removed, moved, replaced or emptied during the run; the run stopped, and what it found "
            "since then is kept only in the output printed here"
        )
