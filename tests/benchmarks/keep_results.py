"""Store the rows of experiments beside the notebooks, and describe them there.

    python tests/benchmarks/keep_results.py scaling=RUN-FOLDER scaling-direct=RUN-FOLDER ...

A run's rows and conditions go to `notebooks/results/NAME.csv` and `NAME.json`, without a row that was cut off. Then
the README of that folder and the pictures of the documentation are made from all its rows; without arguments only
those are made.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import pandas as pd

from topo_search.cli.experiment import NAMES
from topo_search.experiments import Settings, experiment, results

RESULTS = Path(__file__).parents[2] / "notebooks" / "results"
SHOWN = ("scaling", "ablation")
"""Experiments whose pictures the documentation shows."""
HEAD = """# Results of the experiments

Rows of `topo-search experiment NAME`, one file per experiment, with the command, versions and date in the JSON file
of the same name; rows of the method `direct` are from a direct implementation of the paper's formulation. With the
same solver the command, followed by `--out DIR`, makes the same rows, except for seconds and megabytes, in
`DIR/results.csv`; `python tests/benchmarks/keep_results.py NAME=DIR` copies them here, writes this text and draws
the pictures of the documentation. `topo_search/experiments/study.py` explains the columns. To plot the rows in
Python:

```python
from topo_search.experiments import experiment, results

ablation, rows = experiment("ablation"), results("notebooks/results/ablation.csv")
print(ablation.summary(rows))
ablation.figure(rows).savefig("ablation.png")
```

Shares and efforts depend on the small number of starts: more trees may have a design, and a stricter problem can
come out cheaper if its starts were luckier. Tables of an earlier version
show what that one found. Seconds are CPU time of one thread on a machine with other load, which
slows caches and memory; the documentation's page on benchmarks has times of an idle machine. Rows of `wall-push`
are of `tests/designs/wall-push.toml`, with reserves at the tip.
"""


def main() -> None:
    """Store the given runs, and write the README and the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="*", metavar="NAME=FOLDER", help="name of the file, folder of the run")
    for run in parser.parse_args().runs:
        name, _, folder = run.partition("=")
        store(name, Path(folder))
    (RESULTS / "README.md").write_text(HEAD + "".join(map(section, NAMES)), encoding="utf-8")
    for name in SHOWN:
        experiment(name).figure(rows_of(name)).savefig(RESULTS.parent / "pictures" / f"{name}.png", dpi=110)


def store(name: str, folder: Path) -> None:
    """Copy the complete rows of a run, and its conditions."""
    rows = (folder / "results.csv").read_bytes()
    (RESULTS / f"{name}.csv").write_bytes(rows[: rows.rfind(b"\n") + 1])
    (RESULTS / f"{name}.json").write_bytes((folder / "about.json").read_bytes())


def settings_of(value: dict[str, Any]) -> Settings:
    """Return the settings from a value of `Settings.as_json`."""
    tasks = tuple((name, tuple(sizes)) for name, sizes in value["tasks"].items())
    up_to_limit, above_limit = value["topologies"]
    return Settings(
        **{
            **value,
            "tasks": tasks,
            "topologies": (up_to_limit, above_limit),
            "distances": tuple(value["distances"]),
        }
    )


def section(name: str) -> str:
    """Return the section of the README about an experiment, with the rows of all methods."""
    study = experiment(name)
    parts = [f"\n## {study.question}\n"]
    for table in tables(name):
        rows = results(table)
        about = json.loads(table.with_suffix(".json").read_text(encoding="utf-8"))
        planned = len(study.cells(settings_of(about["settings"])))
        parts.append(
            f"\n`{table.name}`, {len(rows)} of {planned} problems, {dated(about)}, of\n\n    {about['command']}\n"
        )
    return "".join(parts)


def dated(about: dict[str, Any]) -> str:
    """Return the version and the date of a table's rows."""
    return f"by version {about['versions']['topo-search']} on {about['date']}"


def tables(name: str) -> list[Path]:
    """Return the tables of an experiment, the solver's first."""
    return sorted(RESULTS.glob(f"{name}*.csv"), key=lambda path: path.stem)


def rows_of(name: str) -> pd.DataFrame:
    """Return the rows of all methods."""
    return pd.concat([results(table) for table in tables(name)], ignore_index=True)


if __name__ == "__main__":
    main()
