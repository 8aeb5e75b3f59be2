"""A run and its folder: what was asked, every candidate's row in the ledger, and the answer."""

from topo_search.study.answer import NEAR, Answer, SizeAnswer
from topo_search.study.audits import AUDITED, audit_best
from topo_search.study.checking import Checked, check
from topo_search.study.claims import REPORT
from topo_search.study.folder import RunFolder
from topo_search.study.front import FrontPoint, front
from topo_search.study.identity import DEFAULT_ROUND, Request, Sampler, StrategyName
from topo_search.study.ledger import Ledger
from topo_search.study.lost import LedgerLost
from topo_search.study.margins import LARGER_MARGINS, larger_margin
from topo_search.study.observer import Observer, Silent
from topo_search.study.own import NOTHING, Own
from topo_search.study.phases import Phase, Plan
from topo_search.study.proving import prove
from topo_search.study.row import COLUMNS, Row, SolveEvent
from topo_search.study.runner import answer_of, run
from topo_search.study.single import Solved, solve_single
from topo_search.study.time_left import TimeLeft

__all__ = [
    "AUDITED",
    "COLUMNS",
    "DEFAULT_ROUND",
    "LARGER_MARGINS",
    "NEAR",
    "NOTHING",
    "REPORT",
    "Answer",
    "Checked",
    "FrontPoint",
    "Ledger",
    "LedgerLost",
    "Observer",
    "Own",
    "Phase",
    "Plan",
    "Request",
    "Row",
    "RunFolder",
    "Sampler",
    "Silent",
    "SizeAnswer",
    "SolveEvent",
    "Solved",
    "StrategyName",
    "TimeLeft",
    "answer_of",
    "audit_best",
    "check",
    "front",
    "larger_margin",
    "prove",
    "run",
    "solve_single",
]
