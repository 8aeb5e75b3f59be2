"""What a user of the package writes: it imports nothing but public names, and worker processes import it."""

import os
import signal
from functools import partial
from itertools import combinations
from multiprocessing import parent_process

import casadi as ca
import optuna

from topo_search import Candidates, Design, OwnConstraint, OwnFormat, OwnSampler, SymbolicPlatform, Topology


def spans(platform: SymbolicPlatform):
    """Distance of any two modules' centres [m]."""
    return ca.vertcat(*(ca.norm_2(a - b) for a, b in combinations(platform.centres, 2)))


def fold_differences(platform: SymbolicPlatform):
    """How far every joint's fold is from their mean [rad]."""
    mean = sum(platform.folds) / len(platform.folds)
    return [fold - mean for fold in platform.folds]


def uprightness(platform: SymbolicPlatform):
    """Vertical part of the first module's thrust axis."""
    return platform.axes[0][2]


def height(platform: SymbolicPlatform, module: int):
    """Of one module over the centre of mass [m]."""
    return platform.centres[module][2]


def sideways(platform: SymbolicPlatform):
    """Of the end-effector along y [m]."""
    return platform.end_effector[1]


def nonsense(platform: SymbolicPlatform):
    return platform.centres[99]


def words(platform: SymbolicPlatform):
    return "large"


def no_number(platform: SymbolicPlatform):
    """Of no platform there is."""
    return ca.sqrt(-1 - platform.centres[0][2] ** 2)


def infinite(platform: SymbolicPlatform):
    return ca.SX(float("inf"))


def strange(platform: SymbolicPlatform):
    """Holds a symbol of nobody."""
    return platform.centres[0][2] + ca.SX.sym("mine")


def span(limit, **fields):
    return OwnConstraint("span", spans, upper=limit, unit="m", invariant="mirror", **fields)


def lifted(module, least, **fields):
    return OwnConstraint(f"height of {module}", partial(height, module=module), lower=least, unit="m", **fields)


EQUAL_FOLDS = OwnConstraint("equal folds", fold_differences, 0.0, 0.0, "rad", version="1", invariant="mirror")
UPRIGHT = OwnConstraint("upright", uprightness, lower=0.99, version="1")


class Fewest:
    """Proposes every tree in turn, as the keys are sorted: a sampler without a state."""

    def propose(self, candidates: Candidates, tried, random) -> Topology | str:
        known = {row.key for row in tried}
        left = [tree for tree in candidates.sample(20, random.getrandbits(32)) if tree.key not in known]
        return min(left or candidates.sample(1, 0), key=lambda tree: tree.key)


def make_random(seed: int) -> optuna.samplers.BaseSampler:
    return optuna.samplers.RandomSampler(seed=seed)


def make_qmc(seed: int) -> optuna.samplers.BaseSampler:
    return optuna.samplers.QMCSampler(seed=seed, warn_independent_sampling=False)


def make_grid(seed: int) -> optuna.samplers.BaseSampler:
    """Of three modules with aligned ports: every row of numbers, in the order of the seed."""
    return optuna.samplers.GridSampler({"port 1": range(4), "port 2": range(6)}, seed=seed)


def make_brute_force(seed: int) -> optuna.samplers.BaseSampler:
    return optuna.samplers.BruteForceSampler(seed=seed)


def make_groups(seed: int) -> optuna.samplers.BaseSampler:
    return optuna.samplers.TPESampler(seed=seed, n_startup_trials=2, multivariate=True, group=True)


MINE = OwnSampler("random rows", make_random, version="1")


def as_text(design: Design) -> str:
    return f"{design.topology_key} {design.objective:.6g}\n"


TEXT = OwnFormat("plain-text", as_text, (".own",), "a line")


def fatal(platform):
    """End whatever process this is evaluated in, but the first."""
    if parent_process() is not None:
        os.kill(os.getpid(), signal.SIGKILL)
    return spans(platform)
