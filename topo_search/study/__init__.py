"""A run and its folder: what was asked, every candidate's row in the ledger, and the answer."""

from topo_search.study.answer import NEAR, Answer, SizeAnswer
from topo_search.study.audits import AUDITED, audit_best
from topo_search.study.folder import REPORT, RunFolder
from topo_search.study.front import Point, front
from topo_search.study.identity import LARGER_MARGINS, Request, Sampler, StrategyName, larger_margin
from topo_search.study.ledger import Ledger
from topo_search.study.lost import LedgerLost
from topo_search.study.observer import Observer, Silent
from topo_search.study.proving import prove
from topo_search.study.row import COLUMNS, Row, Solve
from topo_search.study.runner import answer_of, run
from topo_search.study.single import Solved, solve_single

__all__ = [
    "AUDITED",
    "COLUMNS",
    "LARGER_MARGINS",
    "NEAR",
    "REPORT",
    "Answer",
    "Ledger",
    "LedgerLost",
    "Observer",
    "Point",
    "Request",
    "Row",
    "RunFolder",
    "Sampler",
    "Silent",
    "SizeAnswer",
    "Solve",
    "Solved",
    "StrategyName",
    "answer_of",
    "audit_best",
    "front",
    "larger_margin",
    "prove",
    "run",
    "solve_single",
]
