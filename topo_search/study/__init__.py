"""A run and its folder: what was asked, every candidate's row in the ledger, and the answer."""

from topo_search.study.answer import Answer, SizeAnswer
from topo_search.study.answering import answer_of, read_answer
from topo_search.study.columns import COLUMNS
from topo_search.study.directory import RunFile
from topo_search.study.folder import RunFolder
from topo_search.study.ledger import NEAR_BEST, Row, SolveEvent
from topo_search.study.ledger_file import LedgerLost
from topo_search.study.pareto import FrontPoint, front
from topo_search.study.progress import Observer, Phase, Plan, SilentObserver
from topo_search.study.proving import Checked, check, prove
from topo_search.study.request import DEFAULT_ROUND, NO_INPUTS, Request, Sampler, StrategyName, UserInputs
from topo_search.study.running import run
from topo_search.study.single import Solved, solve_single
from topo_search.study.time_left import TimeLeft
