"""From a mission file to a Mission: everything that can be wrong in the text is found here, all at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ...files.expressions.type_inference import ValueType
from ...files.yaml.document import Document, Fault, FileError, open_document, read_document
from ..mission import Mission, TreeSpec
from ..mission_files import FilesOnDisk, MissionFiles
from ..node import Node
from ..subtree_calls import check_calls
from ..values.expression_pointer import Pointer
from ..values.fault_collector import Faults
from ..wiring.circuit import Circuit
from ..wiring.expression_checks import unanswerable
from ..wiring.key_writers import FACT_TYPES
from ..wiring.wiring_faults import misfits
from .include import Includes
from .mission_head import MissionHead
from .registry import Registry
from .tree_set import Forest


@dataclass(frozen=True, slots=True)
class Reading:
    """What a mission file gave. With faults the mission is only what could be read of it."""

    mission: Mission
    faults: tuple[Fault, ...]
    circuit: Circuit | None
    """What is wired to what; None where sub-trees call each other in a circle."""
    pointer: Pointer


def load_mission(path: Path, registry: Registry | None = None) -> Mission:
    """Read a mission file. Raises FileError with all its faults."""
    return read_mission(open_document(path, "mission"), registry)


def parse_mission(
    text: str,
    path: Path,
    registry: Registry | None = None,
    files: MissionFiles | None = None,
    facts: Mapping[str, ValueType] = FACT_TYPES,
) -> Mission:
    """As `load_mission`, of a text that was read already; `path` says what lies beside it.

    `files` gives the included files, by default from the disk; `facts` are what expressions may name of the
    world.
    """
    return read_mission(read_document(text, path, "mission"), registry, files, facts)


def read_mission(
    document: Document,
    registry: Registry | None = None,
    files: MissionFiles | None = None,
    facts: Mapping[str, ValueType] = FACT_TYPES,
) -> Mission:
    """Check a document of kind `mission`. Raises FileError with all its faults, and for a library."""
    reading = examine(document, registry, files, facts)
    faults = [fault for fault in reading.faults if fault.severity == "error"]
    if not faults and reading.mission.library:
        message = "this file is for inclusion: it has no tree 'Main' to begin with"
        faults.append(document.fault(("library",), message, code="P206"))
    if faults:
        raise FileError(faults)
    return reading.mission


def examine(
    document: Document,
    registry: Registry | None = None,
    files: MissionFiles | None = None,
    facts: Mapping[str, ValueType] = FACT_TYPES,
) -> Reading:
    """As `read_mission`, for who wants to look at a faulty mission too, or at a library."""
    beside = files or FilesOnDisk(document.path.parent)
    return _Reader(document, (registry or Registry()).copy(), beside, facts).read()


class _Reader:
    def __init__(
        self, document: Document, registry: Registry, files: MissionFiles, facts: Mapping[str, ValueType]
    ) -> None:
        self._document = document
        self._registry = registry
        self._files = files
        self._facts = facts
        self._faults = Faults()

    def read(self) -> Reading:
        document, faults = self._document, self._faults
        for fault in document.faults:
            faults.add(fault)
        before = len(faults)
        included = Includes(self._files, faults).of(document)
        lacking = len(faults) > before
        documents = (document, *included)
        pointer = Pointer(documents)
        heads = [MissionHead(each, self._registry, faults, pointer) for each in documents]
        plugins: list[str] = []
        for head in heads:
            head.check_keys()
            plugins += head.plugins()
        trees = Forest(self._registry, faults, pointer, lacking=lacking).read(documents)
        circuit = self._circuit(trees, pointer)
        head = heads[0]
        mission = Mission(
            head.text("name") or document.path.stem,
            trees,
            document,
            head.text("scene"),
            head.goal(),
            tuple(dict.fromkeys(plugins)),
            included,
            head.library,
            sources=self._registry.plugins_of(_classes(trees)),
        )
        return Reading(mission, faults.all(), circuit, pointer)

    def _circuit(self, trees: Mapping[str, TreeSpec], pointer: Pointer) -> Circuit | None:
        """What is wired to what, checked: what can be wrong between nodes that are right by themselves."""
        calls = tuple(check_calls(trees))
        for fault in calls:
            self._faults.add(fault)
        if calls:
            return None
        # Where a node could not be read, a key may be written that nobody sees.
        unfinished = [name for name in trees if self._faults.within(name)]
        circuit = Circuit(trees, self._facts)
        for fault in (*misfits(circuit), *unanswerable(circuit, pointer, unfinished)):
            self._faults.add(fault)
        return circuit


def _classes(trees: Mapping[str, TreeSpec]) -> set[type[Node]]:
    """The classes of all nodes in the trees."""
    return {spec.node for tree in trees.values() for spec in tree.root.iterate() if spec.node is not None}
