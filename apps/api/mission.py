"""Missions in Python: loaded from a file or made of nodes; checked, drawn, saved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from picktree.authoring import MissionCheck, check_mission, mission_chart
from picktree.files import Diagnostic, FileError, PicktreeError, file_system
from picktree.files.yaml import Document, read_document
from picktree.trees import MAIN, MissionSource, Node, TreeDefinition, python_faults
from picktree.trees import mission as loaded
from picktree.trees.loading import NodeRegistry

from .display import TreeDrawing, preformatted


@dataclass(frozen=True, slots=True)
class CheckReport:
    """Faults of a mission. It is true when there is no error; warnings come from the linter."""

    faults: tuple[Diagnostic, ...]

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        """Faults that keep the mission from running."""
        return tuple(fault for fault in self.faults if fault.severity == "error")

    @property
    def warnings(self) -> tuple[Diagnostic, ...]:
        """Warnings of the linter."""
        return tuple(fault for fault in self.faults if fault.severity == "warning")

    def __bool__(self) -> bool:
        return not self.errors

    def __repr__(self) -> str:
        lines = [f"{fault.severity} {fault.code}: {fault}" for fault in self.faults]
        return "\n".join(lines) or "no errors or warnings"

    def _repr_html_(self) -> str:
        return preformatted(repr(self))


class Mission:
    """Mission: the tree that a run ticks, its scene and its goal.

    `Mission(tree, scene="sort_small")` makes one of nodes; `load` reads a file. A notebook shows its drawing.
    """

    def __init__(
        self,
        tree: Node | MissionSource | Document,
        *,
        scene: str | None = None,
        goal: str | None = None,
        name: str = "mission",
        ports: Mapping[str, object] | None = None,
        include: tuple[str, ...] = (),
        folder: str | PathLike[str] = ".",
    ) -> None:
        """Make a mission whose `Main` is this tree.

        `ports` declares the parameters of the mission, `include` files with further trees. `folder` is the
        place that scenes, included files and plug-ins are looked for in.
        """
        self._source: MissionSource | None = None
        if isinstance(tree, Document):
            self._document = tree
            return
        if isinstance(tree, Node):
            tree = MissionSource(TreeDefinition(MAIN, tree, ports), name, scene, goal, include)
        self._source = tree
        self._document = tree.document(Path(folder).absolute())

    @property
    def name(self) -> str:
        return str(self._document.data.get("name") or self._document.path.stem)

    @property
    def file(self) -> Path | None:
        """File of the mission; None when it was made in Python."""
        return None if self._source is not None else self._document.path

    @property
    def place(self) -> Path:
        """File of the mission, or the place of the file that it would have."""
        return self._document.path

    @property
    def is_complete_text(self) -> bool:
        """Whether the text names all nodes; it cannot name classes of a script or a notebook."""
        return self._source is None or not self._source.local_classes(self.place.parent)

    @property
    def text(self) -> str:
        """Text of the mission's file."""
        return self._document.text

    def check(self) -> CheckReport:
        """Return all errors of the mission and its scene, and the linter's warnings."""
        return CheckReport(self._faults(self._check()))

    def checked(self) -> loaded.Mission:
        """Return the checked mission for a run. Raises FileError with all its errors."""
        check = self._check()
        errors = [fault for fault in check.faults if fault.severity == "error"]
        if errors or check.mission is None:
            raise FileError(self._faults(check, "error"))
        return check.mission

    def render(self, file: str | PathLike[str] | None = None, *, expand: bool = False) -> TreeDrawing:
        """Return the drawing of the trees, and write it to a .svg, .html, .dot or .txt file if one is given.

        `expand` writes each sub-tree out wherever it is called. Raises FileError for a faulty mission.
        """
        drawing = TreeDrawing(mission_chart.chart(self._mission()), expand=expand)
        if file is not None:
            drawing.save(file)
        return drawing

    def save(self, file: str | PathLike[str]) -> Path:
        """Write the mission as a file, and return its path.

        Raises PicktreeError for nodes that no file offers, and when the disk refuses.
        """
        path = Path(file)
        if self._source is not None:
            self._source.save(path)
        else:
            try:
                path.write_text(self.text, encoding="utf-8")
            except OSError as error:
                raise PicktreeError(f"{path}: the mission cannot be written: {error.strerror}") from None
        return path

    def _mission(self) -> loaded.Mission:
        """Return the mission for a drawing; its scene is not looked at."""
        check = self._check()
        if check.mission is None:
            raise FileError(self._faults(check, "error"))
        return check.mission

    def _check(self) -> MissionCheck:
        folder = self._document.path.parent
        nodes = self._source.local_classes(folder) if self._source is not None else ()
        return check_mission(self._document, NodeRegistry(nodes))

    def _faults(self, check: MissionCheck, severity: str = "") -> tuple[Diagnostic, ...]:
        faults = tuple(fault for fault in check.faults if fault.severity == (severity or fault.severity))
        return python_faults(faults) if self._source is not None else faults

    def __repr__(self) -> str:
        return f"<mission {self.name!r}: {', '.join(self._document.data.get('trees') or ())}>"  # type: ignore[arg-type]

    def _repr_svg_(self) -> str | None:
        try:
            return self.render()._repr_svg_()  # pyright: ignore[reportPrivateUsage]
        except FileError:
            return None

    def _repr_html_(self) -> str | None:
        report = self.check()
        return None if report else preformatted(f"{self.name}\n{report}")


def load(file: str | PathLike[str]) -> Mission:
    """Load a mission file, or a shipped example by its name.

    Raises FileError when it is no mission file; `check` shows its other faults.
    """
    return Mission(read_document(file_system.example_file(file), "mission"))
