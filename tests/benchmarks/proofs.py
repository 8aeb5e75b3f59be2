"""Boxes and processor time of the proof of every tree of a task: python tests/benchmarks/proofs.py RUN --gap 0.01.

RUN is the folder of a finished run; nothing is written to it. The compilation is done before the first tree.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from nlp import prove_chunk
from topo_search.model import Topology
from topo_search.model.proof import chunk_count
from topo_search.study import RunFolder
from topo_search.study.proofs import target


def main() -> None:
    """Print a row for every tree."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--gap", type=float, default=0.01)
    parser.add_argument("--trees", nargs="*", help="keys; default: all")
    asked = parser.parse_args()
    with RunFolder.found(asked.run) as folder:
        for n in folder.request.task.sizes:
            task, best = folder.request.contexts(n)[0].task, folder.ledger.best_clear(n)
            if best is None or best.objective is None:
                continue
            prove_chunk(task, Topology.from_key(best.key), 0, best.objective, most_boxes=1)
            print("key        aim         cut/best     boxes   CPU s  chunks closed")
            for row in folder.ledger.ranked(n):
                if row.status == "impossible" or (asked.trees and row.key not in asked.trees):
                    continue
                aim, cut = target(row, best.objective, asked.gap)
                tree, began, boxes, closed = Topology.from_key(row.key), time.process_time(), 0, 0
                for number in range(chunk_count(n)):
                    chunk = prove_chunk(task, tree, number, cut)
                    boxes, closed = boxes + chunk.boxes, closed + (chunk.outcome == "closed")
                    if chunk.outcome != "closed":
                        break
                seconds = time.process_time() - began
                told = f"{row.key:10} {aim:9} {cut / best.objective:10.5f} {boxes:9,} {seconds:7.1f}"
                print(f"{told}  {closed} of {chunk_count(n)}", flush=True)


if __name__ == "__main__":
    main()
