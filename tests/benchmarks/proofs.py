"""Boxes and CPU time of the proof of every tree of a task.

    python tests/benchmarks/proofs.py RUN --gap 0.01

RUN is the folder of a finished run; nothing is written to it. The first line lists the requirements that the bound
accounts for beyond load cases and airflow. Code is compiled before the first tree. With --check every proven chunk
is checked. With --sample M only M random trees are proven, and the cost of all is extrapolated, with the standard
error. (Chunks of one tree differ too much for a sample.) A tree ends at its first open chunk; --most-boxes N tries
every chunk with at most N boxes.
"""

from __future__ import annotations

import argparse
import math
import random
import time
from pathlib import Path
from statistics import mean, stdev
from typing import get_args

from nlp import proof_root, prove_chunk
from nlp.bounds.branch.proof import MAX_BOXES
from topo_search.model import Chunk, Topology
from topo_search.model.proof import Problem, chunk_count
from topo_search.study import RunFolder
from topo_search.study.proofs import bounded_requirements, target
from verify import check_chunk


def main() -> None:
    """Prove, and print a row for every tree."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--gap", type=float, default=0.01)
    parser.add_argument("--problem", choices=get_args(Problem), default="task")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--sample", type=int, metavar="M", help="at least 2")
    parser.add_argument("--seed", type=int, default=0, help="seed of the sample")
    parser.add_argument("--trees", nargs="*", help="keys; default: all")
    parser.add_argument(
        "--most-boxes", type=int, metavar="N", help="largest number of boxes per chunk; tries every chunk"
    )
    arguments = parser.parse_args()
    with RunFolder.load(arguments.run) as folder:
        for n in folder.request.task.sizes:
            task, best = folder.request.contexts(n)[0].task, folder.ledger.best_clear(n)
            if best is None or best.objective is None:
                continue
            prove_chunk(task, Topology.from_key(best.key), 0, best.objective, arguments.problem, most_boxes=1)
            if arguments.check:
                check_chunk(task, Topology.from_key(best.key), 0, best.objective, Chunk.of(0, "closed", b"\0"))
            requirements = ", ".join(bounded_requirements(task, arguments.problem))
            print(f"{task.name}, {n} modules, proofs about the {arguments.problem}: {requirements}")
            print("key        aim         cut/best     boxes   CPU s  chunks closed, check: CPU s, boxes halved")
            rows = [row for row in folder.ledger.ranking(n) if not arguments.trees or row.key in arguments.trees]
            drawn = random.Random(arguments.seed).sample(rows, arguments.sample) if arguments.sample else rows
            costs = list[tuple[int, float]]()
            for row in drawn:
                aim, cut = target(row, best.objective, arguments.gap)
                tree, boxes, closed, halved, seconds, checking = Topology.from_key(row.key), 0, 0, 0, 0.0, 0.0
                for number in range(chunk_count(n)):
                    started = time.process_time()
                    most_boxes = arguments.most_boxes or MAX_BOXES
                    chunk = prove_chunk(task, tree, number, cut, arguments.problem, most_boxes=most_boxes)
                    seconds += time.process_time() - started
                    boxes, closed = boxes + chunk.boxes, closed + (chunk.outcome == "closed")
                    if chunk.outcome != "closed" and not arguments.most_boxes:
                        break
                    if chunk.outcome == "closed" and arguments.check:
                        started = time.process_time()
                        check = check_chunk(task, tree, proof_root(task, tree), cut, chunk, arguments.problem)
                        checking += time.process_time() - started
                        halved += check.halved
                        if check.fault is not None:
                            raise SystemExit(f"{row.key}, chunk {number}: {check.fault}")
                line = f"{row.key:10} {aim:9} {cut / best.objective:10.5f} {boxes:9,} {seconds:7.1f}"
                line += f"  {closed} of {chunk_count(n)}"
                print(line + (f", {checking:7.1f} {halved:9,}" if arguments.check else ""), flush=True)
                costs.append((boxes, seconds))
            if arguments.sample:
                total = f"{_extrapolate(costs, len(rows), 0)} boxes, {_extrapolate(costs, len(rows), 1)} s"
                print(f"all {len(rows)} trees: {total}")


def _extrapolate(costs: list[tuple[int, float]], trees: int, column: int) -> str:
    """Extrapolate boxes or seconds from a sample without replacement to all trees, with the standard error."""
    drawn = [cost[column] for cost in costs]
    error = stdev(drawn) * math.sqrt((1 - len(drawn) / trees) / len(drawn))
    return f"{trees * mean(drawn):,.0f} +- {trees * error:,.0f}"


if __name__ == "__main__":
    main()
