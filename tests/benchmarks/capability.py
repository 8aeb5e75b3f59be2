"""Values of a maximised quantity that are proven impossible for a tree, against the CPU time of the proof.

    python tests/benchmarks/capability.py TASK KEY --values 0.42 0.4 0.38 0.36 0.34 0.33 [--check] [--csv FILE]

TASK is a task file with `search.maximize`, KEY the key of a tree of its size. Values are in weights of the platform
for a force reserve, else in the unit of the quantity. Code is compiled first. With --check every chunk is
checked. The closed form for the size is printed first. With --csv a row is added for every value.
"""

from __future__ import annotations

import argparse
import csv
import time
from pathlib import Path

from nlp import largest_value, proof_root, prove_chunk
from nlp.bounds.branch.proof import MAX_BOXES
from topo_search.model import Chunk, ResolvedTask, Topology
from topo_search.model.maximized import provable_at
from topo_search.model.proof import chunk_count, most_effort
from topo_search.model.task_file import read_task
from verify import check_chunk


def main() -> None:
    """Prove each value, and print a row for it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task")
    parser.add_argument("key")
    parser.add_argument("--values", type=float, nargs="+", required=True)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--most-boxes", type=int, default=MAX_BOXES)
    parser.add_argument("--csv", type=Path)
    arguments = parser.parse_args()
    tree = Topology.from_key(arguments.key)
    task = read_task(arguments.task).resolve(tree.n)
    unit = task.force_unit(tree.n) if task.search.maximize == "force_reserve" else 1.0
    print(f"closed form: {largest_value(task) / unit:.4f}")
    print("value   outcome  boxes     CPU s  check: CPU s, boxes halved", flush=True)
    for value in arguments.values:
        row = measured(provable_at(task, value * unit), tree, arguments.most_boxes, check=arguments.check)
        print(f"{value:<8g}{row[0]:9}{row[1]:<10,}{row[2]:<7.1f}{row[3]:.1f}, {row[4]:,}", flush=True)
        if arguments.csv is not None:
            with arguments.csv.open("a", newline="", encoding="utf-8") as file:
                csv.writer(file).writerow([task.name, arguments.key, value, *row])


def measured(
    task: ResolvedTask, tree: Topology, most_boxes: int, *, check: bool
) -> tuple[str, int, float, float, int]:
    """Return the outcome, the boxes and CPU time [s] of a proof, and the CPU time and halved boxes of its check."""
    cut, root = most_effort(task), proof_root(task, tree)
    prove_chunk(task, tree, 0, cut, most_boxes=1)
    if check:
        check_chunk(task, tree, root, cut, Chunk.of(0, "closed", b"\0"))
    boxes, proving, checking, halved = 0, 0.0, 0.0, 0
    for number in range(chunk_count(tree.n)):
        started_at = time.process_time()
        chunk = prove_chunk(task, tree, number, cut, most_boxes=most_boxes)
        proving, boxes = proving + time.process_time() - started_at, boxes + chunk.boxes
        if chunk.outcome != "closed":
            return chunk.outcome, boxes, proving, checking, halved
        if check:
            started_at = time.process_time()
            result = check_chunk(task, tree, root, cut, chunk)
            checking, halved = checking + time.process_time() - started_at, halved + result.halved
            if result.fault is not None:
                return result.fault, boxes, proving, checking, halved
    return "closed", boxes, proving, checking, halved


if __name__ == "__main__":
    main()
