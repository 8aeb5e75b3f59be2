"""Shell completion as the installation page shows it: the scripts exist, and Tab completes commands and choices."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from documented import PAGES

COMMAND = str(Path(sys.executable).with_name("topo-search"))


def asked(**variables: str) -> str:
    environment = {**os.environ, **variables}
    return subprocess.run([COMMAND], env=environment, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_documented_script_is_printed(shell):
    if shell == "bash" and shutil.which("bash") is None:
        pytest.skip("click asks bash for its version")
    shown = (PAGES / "installation.md").read_text(encoding="utf-8")
    (variable,) = re.findall(rf"(_\w+)={shell}_source", shown)
    script = asked(**{variable: f"{shell}_source"})
    assert f"{variable}={shell}_complete" in script


@pytest.mark.parametrize(
    ("words", "word", "offered"),
    [
        ("topo-search ", "1", "audit"),
        ("topo-search run push --sampler n", "4", "nsga2"),
        ("topo-search run --pa", "2", "--paper"),
    ],
)
def test_tab_completes_commands_options_and_choices(words, word, offered):
    told = asked(_TOPO_SEARCH_COMPLETE="bash_complete", COMP_WORDS=words, COMP_CWORD=word)
    assert f"plain,{offered}" in told.splitlines()
