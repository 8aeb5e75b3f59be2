"""Time and memory of commands with inputs at the limits of what is accepted, and beyond.

    python tests/benchmarks/limits.py [PART ...]

Each input is made in a temporary folder, and each command runs in a separate process. CPU time and peak resident
memory are those of the command and its children, as reported by the system.
"""

from __future__ import annotations

import argparse
import os
import resource
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from topo_search.limits import LIMITS
from topo_search.topologies import sample

HEAD = 'name = "limit"\nmodules = 5\n'
HOVER = "[[load_cases]]\ncom = { force = [0.0, 0.0, 1.0] }\n"


def cases(number: int) -> str:
    """Return load cases with forces near that of hover."""
    forces = np.random.default_rng(0).uniform(-0.2, 0.2, (number, 3)) + np.array([0, 0, 1])
    return "".join(f"[[load_cases]]\ncom = {{ force = {force} }}\n" for force in forces.tolist())


def mesh(number: int) -> bytes:
    """Return a binary STL of random facets."""
    facets = np.zeros(number, [("normal", "<f4", 3), ("corners", "<f4", 9), ("attribute", "<u2")])
    facets["corners"] = np.random.default_rng(0).normal(size=(number, 9))
    return bytes(80) + struct.pack("<I", number) + facets.tobytes()


def inputs(folder: Path) -> dict[str, list[str]]:
    """Write the inputs, and return the command of every part."""
    turn = np.linspace(0, 2 * np.pi, LIMITS.segments, endpoint=False)
    around = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1).tolist()
    sphere = np.random.default_rng(0).normal(size=(LIMITS.corners, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    tasks = {
        "load-cases": HEAD + cases(LIMITS.load_cases),
        "load-cases-beyond": HEAD + cases(10_000),
        "segments": HEAD + HOVER + f'[[exposure]]\nkind = "directional"\nsegments = {around}\n',
        "segments-beyond": HEAD
        + HOVER
        + '[[exposure]]\nkind = "directional"\nsegments = ['
        + "[1, 0, 0]," * 100_000
        + "]",
        "corners": HEAD + HOVER + f'[[exposure]]\nkind = "local"\nvertices = {(0.1 * sphere).tolist()}\n' * 20,
        "facets": HEAD + HOVER + '[[exposure]]\nkind = "local"\nmesh = "facets.stl"\n',
        "facets-beyond": HEAD + HOVER + '[[exposure]]\nkind = "local"\nmesh = "beyond.stl"\n',
        "key-beyond": HEAD + HOVER + "a" + ".a" * 100_000 + " = 1\n",
    }
    for name, text in tasks.items():
        (folder / f"{name}.toml").write_text(text)
    (folder / "facets.stl").write_bytes(mesh(LIMITS.facets))
    (folder / "beyond.stl").write_bytes(mesh(1_000_000))
    commands = {name: ["check", f"{name}.toml"] for name in tasks}
    far = ["--starts", "1", "--set", "module.connector_distance=0.5"]
    commands["modules"] = ["solve", "ten-wrenches", "--topology", sample(LIMITS.modules, 1, 0)[0].key, *far]
    commands["modules-beyond"] = ["check", "push", "--modules", "10000"]
    commands["solve-load-cases"] = ["solve", "load-cases.toml", "--topology", "a70010", "--starts", "1"]
    return commands


def main() -> None:
    """Run and print one line per part."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*")
    chosen = parser.parse_args().parts
    with tempfile.TemporaryDirectory() as folder:
        commands = inputs(Path(folder))
        for name in chosen or commands:
            child = os.fork()  # so that RUSAGE_CHILDREN covers only this part
            if child == 0:
                command = [sys.executable, "-m", "topo_search", *commands[name]]
                process = subprocess.run(command, cwd=folder, capture_output=True, text=True)
                usage = resource.getrusage(resource.RUSAGE_CHILDREN)
                last_line = (process.stderr or process.stdout).strip().splitlines()[-1][:90]
                seconds = usage.ru_utime + usage.ru_stime
                memory = usage.ru_maxrss / 1024
                print(f"{name:18} {seconds:6.1f} s {memory:5.0f} MB  exit {process.returncode}  {last_line}")
                sys.stdout.flush()
                os._exit(0)
            os.waitpid(child, 0)


if __name__ == "__main__":
    main()
