"""Proposals of candidates where there are too many to solve all: Optuna studies over trees."""

from topo_search.engine.proposals.study import OptunaSearch
