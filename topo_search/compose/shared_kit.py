"""One drawer of brackets for several tasks, as `kit.json` holds it: designs, brackets, and changes by joints."""

from typing import Literal

from pydantic import ConfigDict, Field

from topo_search.export.brackets import DIGITS, bracket_file
from topo_search.export.kit import BRACKETS
from topo_search.model.kinds import Index, Number
from topo_search.model.proven import upper_text
from topo_search.model.topology import PORT_NAMES
from topo_search.model.value import Value
from topo_search.report.wording import quantity


class ChosenDesign(Value):
    """The design chosen for a task."""

    task: str
    run: str
    """Folder of the task's run."""
    design: str
    """File of the design, relative to the folder of the kit."""
    topology_key: str
    over_best_percent: Number
    """Effort over the least effort of its task [%]."""


class Brackets(Value):
    """Brackets of one kind in the drawer."""

    angle_deg: Number
    """Size of the hinge angle [deg]."""
    count: Index
    """Number in the drawer: the largest number that any task needs."""

    @property
    def file(self) -> str:
        """STL file, relative to the folder of the kit."""
        return f"{BRACKETS}/{bracket_file(self.angle_deg)}"


class Step(Value):
    """One joint to undo or to bolt, by which a module leaves or joins the piece that the other modules form."""

    module: Index
    """The module that moves."""
    port: Index
    to: Index
    """The module of the piece at the joint."""
    to_port: Index
    bracket_deg: Number
    """Kind of the bracket: the size of the hinge angle [deg]."""

    @property
    def words(self) -> str:
        """The joint in words."""
        return (
            f"port {PORT_NAMES[self.port]} of module {self.module}, port {PORT_NAMES[self.to_port]} of module "
            f"{self.to}, bracket of {self.bracket_deg:.{DIGITS}f} deg"
        )


class Change(Value):
    """Joints to undo and to bolt from one task to the next; the shared part stays in one piece."""

    model_config = ConfigDict(serialize_by_alias=True, validate_by_name=True)

    before: str = Field(alias="from")
    """Task."""
    after: str = Field(alias="to")
    """The next task."""
    undo: Index
    """Number of joints to undo."""
    bolt: Index
    """Number of joints to bolt."""
    undo_steps: tuple[Step, ...]
    """In order, with module numbers of the design before; the rest stays in one piece."""
    bolt_steps: tuple[Step, ...]
    """In order, with module numbers of the design after; the bolted part is in one piece."""
    stay: tuple[tuple[Index, Index], ...]
    """Modules that stay bolted together: number in the design before, number in the design after."""

    @property
    def words(self) -> str:
        """Instruction for the change, without a full stop."""
        undo = quantity(self.undo, "joint")
        text = f"from {self.before} to {self.after}: undo {undo}, then bolt {self.bolt}"
        if len(self.stay) == 1:
            return f"{text}; no two modules stay together"
        stay = ", ".join(f"{i} as {j}" for i, j in self.stay)
        return f"{text}; these modules stay bolted together in one piece: {stay}"

    @property
    def instructions(self) -> list[str]:
        """The steps, one sentence each, in order."""
        steps = [("Undo", step) for step in self.undo_steps] + [("Bolt", step) for step in self.bolt_steps]
        return [f"{number}. {verb} {step.words}." for number, (verb, step) in enumerate(steps, start=1)]


class SharedKit(Value):
    """One drawer of brackets for several tasks, as `kit.json` holds it."""

    format: Literal["topo-search/kit"] = "topo-search/kit"
    version: Literal[1] = 1
    within_percent: Number
    """Largest effort of a choice over the least effort of its task [%]."""
    modules: Index
    """Number of modules of the largest design."""
    tasks: tuple[ChosenDesign, ...]
    """In the order given."""
    brackets: tuple[Brackets, ...]
    """By angle. No choice among the designs kept needs fewer brackets in total."""
    changes: tuple[Change, ...]
    """One from each task to the next."""
    designs_kept: tuple[Index, ...]
    """Number of designs to choose from, for each task."""

    @property
    def lines(self) -> list[str]:
        """The drawer, the tasks and the changes in words."""
        brackets, kinds = sum(kind.count for kind in self.brackets), quantity(len(self.brackets), "kind")
        excess = upper_text(max(task.over_best_percent for task in self.tasks), 3)
        choices = " x ".join(map(str, self.designs_kept))
        return [
            f"{self.modules} modules and {brackets} brackets of {kinds} do all tasks "
            f"within {excess} % of their least effort",
            f"no choice among the designs kept ({choices}) needs fewer brackets",
            *(f"bracket {kind.angle_deg:.{DIGITS}f} deg: {kind.count}" for kind in self.brackets),
            *(
                f"{task.task}: {task.topology_key}, {upper_text(task.over_best_percent, 3)} % over the least effort"
                for task in self.tasks
            ),
            *(change.words for change in self.changes),
        ]

    @property
    def pages(self) -> list[str]:
        """File names of the sheets, one for each change."""
        return [
            f"change-{number}-{change.before}-{change.after}.html"
            for number, change in enumerate(self.changes, start=1)
        ]
