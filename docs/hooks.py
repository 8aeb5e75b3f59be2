"""What the site takes from the product while it is built: pictures, the gallery, the task file, JSON schemas."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from topo_search.export.allocation import Allocation
from topo_search.model import Audit, Design, Task
from topo_search.model.files import examples, read_task
from topo_search.model.template import task_template

PICTURES = Path(__file__).parents[1] / "notebooks/pictures"
SCHEMAS = {"task": Task, "design": Design, "audit": Audit, "allocation": Allocation}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pictures that notebooks draw, and the schemas."""
    for picture in sorted(PICTURES.glob("*.png")):
        files.append(File.generated(config, f"pictures/{picture.name}", abs_src_path=str(picture)))
    for name, model in SCHEMAS.items():
        schema = json.dumps(model.model_json_schema(), indent=2)
        files.append(File.generated(config, f"schemas/{name}.json", content=schema))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Fill in what is generated: a page names it in a comment on a line of its own."""
    for mark, generate in GENERATED.items():
        if f"<!-- {mark} -->" in markdown:
            markdown = markdown.replace(f"<!-- {mark} -->", generate())
    return markdown


def _task_file() -> str:
    return f"```toml\n{task_template('my-task')}```"


def _gallery() -> str:
    return "\n".join(_shown(name) for name in examples())


def _shown(name: str) -> str:
    """Return an example's command and file; a task's first comment says what it teaches."""
    task = read_task(name)
    sizes = task.modules if isinstance(task.modules, int) else "{} to {}".format(*task.modules)
    text = (resources.files("topo_search") / "examples" / f"{name}.toml").read_text(encoding="utf-8")
    return f"## {name}\n\n{sizes} modules, `topo-search run {name}`:\n\n```toml\n{text}```\n"


GENERATED = {"task file": _task_file, "gallery": _gallery}
