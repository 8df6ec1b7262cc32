"""Description of trees in Python: children and ports as a node's constructor received them, a named tree
with ports, and the text of a mission.
"""

from __future__ import annotations

import inspect
import keyword
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, Final, Protocol, TypeAlias, cast

from py_trees.behaviour import Behaviour

from picktree.files import Diagnostic, Mark, PicktreeError, suggest_name
from picktree.files.yaml import Document, Value, from_value, mission_text, read_document, value_text

from .declaration import NodeDeclaration
from .port_types import show
from .ports import PortDeclaration, SlotDeclaration


class Described(Protocol):
    """Node that was made in Python."""

    @property
    def description(self) -> NodeDescription: ...


class CalledTree(Protocol):
    """Tree that was made in Python, as far as a call of it needs it."""

    name: str
    root: NodeDescription
    ports: dict[str, Value]

    def value(self) -> Value: ...


Child: TypeAlias = Described | Iterable[Described]
"""A node, or a list of nodes that runs as a Sequence."""
_Part: TypeAlias = "NodeDescription | tuple[NodeDescription, ...]"
Filled: TypeAlias = "_Part | dict[str, _Part]"
"""Children of a slot: one node, a list, or a table of either."""


@dataclass(frozen=True, slots=True)
class NodeDescription:
    """Ports and children of a node that was made in Python, before it is checked."""

    id: str
    node: type
    """Class of the node."""
    ports: Mapping[str, Value]
    """Values by the key that a mission file has for them; those of `name` and of conditions, too."""
    slots: Mapping[str, Filled]
    tree: CalledTree | None = None
    """Tree that the node calls; None: the node is of a class."""

    def value(self) -> Value:
        """Return the node as a mission file has it: a bare ID, or a mapping with one key."""
        body: dict[str, Value] = {**self.ports}
        body.update((key, _filled_value(filled)) for key, filled in self.slots.items())
        if not body:
            return self.id
        if list(body) == ["do"] and isinstance(body["do"], list):
            return {self.id: body["do"]}
        return {self.id: body}

    def iterate(self) -> Iterator[NodeDescription]:
        """Yield the node and its descendants in the same tree, parents first."""
        yield self
        for filled in self.slots.values():
            for part in filled.values() if isinstance(filled, dict) else (filled,):
                for child in part if isinstance(part, tuple) else (part,):
                    yield from child.iterate()


def describe(
    node: type, declaration: NodeDeclaration, children: Iterable[Child], keys: Mapping[str, object]
) -> NodeDescription:
    """Return the description of a node with these arguments of its constructor.

    A key that is a word of Python has an underscore behind it: `in_`. Values stay unchecked until the tree is
    loaded. Raises TypeError for a port that the node does not have, one that is missing, or children that it
    cannot have.
    """
    ports: dict[str, Value] = {}
    slots: dict[str, Filled] = {}
    given = tuple(children)
    if given:
        slots["do"] = _positional(declaration, given)
    for name, value in keys.items():
        key = file_key(declaration, name)
        slot = declaration.slot(key)
        if slot is None:
            ports[key] = plain_value(value, f"port {key!r} of {declaration.id}")
        elif key in slots:
            raise TypeError(f"{declaration.id} has its children twice: in brackets and as {key!r}")
        else:
            slots[key] = _slot(declaration, slot, value)
    missing = [port for port in declaration.ports if port.required and port.key not in ports]
    if missing:
        raise TypeError(f"{declaration.id}: port {missing[0].key!r} is missing: {missing[0].doc}")
    for slot in declaration.slots:
        if slot.required and slot.key not in slots:
            raise TypeError(f"{declaration.id}: {_slot_subject(slot)} missing: {slot.doc}")
    ordered = {slot.key: slots[slot.key] for slot in declaration.slots if slot.key in slots}
    return NodeDescription(declaration.id, node, ports, ordered)


def file_key(declaration: NodeDeclaration, name: str) -> str:
    """Return the key of a mission file for an argument. Raises TypeError with the nearest name."""
    bare = name.removesuffix("_")
    key = bare if keyword.iskeyword(bare) else name
    if key in declaration.keys:
        return key
    known = [python_name(key) for key in declaration.keys if name.startswith("_") or not key.startswith("_")]
    hint = suggest_name(name, known)
    raise TypeError(f"{declaration.id} has no port {name!r}" + (f" ({hint})" if hint else ""))


def python_name(key: str) -> str:
    """Return the name of an argument for a key of a mission file.

    >>> python_name("in"), python_name("force")
    ('in_', 'force')
    """
    return f"{key}_" if keyword.iskeyword(key) else key


def plain_value(value: object, what: str) -> Value:
    """Return a value as a YAML file can hold it; numpy's numbers and arrays become plain ones.

    Raises TypeError for anything else; `what` names its place.
    """
    match value:
        case None | bool():
            return value
        case int():  # as the next two also of a sub-class: an enumeration, numpy's float
            return int(value)
        case float():
            return float(value)
        case str():
            return str.__str__(value)
        case list() | tuple():
            return [plain_value(item, what) for item in cast("list[object]", value)]
        case dict():
            entries = cast("dict[object, object]", value)
            return {str(key): plain_value(item, what) for key, item in entries.items()}
        case _:
            pass
    to_plain = getattr(value, "tolist", None)  # numpy's arrays and scalars
    if callable(to_plain):
        return plain_value(to_plain(), what)
    hint = "; its id is a text: give '.id'" if isinstance(getattr(value, "id", None), str) else ""
    raise TypeError(f"{what}: a value of type {type(value).__name__} is not allowed in a mission{hint}")


def _positional(declaration: NodeDeclaration, given: tuple[Child, ...]) -> Filled:
    main = declaration.slot("do")
    if main is None:
        raise TypeError(
            f"{declaration.id} has no children; its ports are given by name, as {_usage(declaration)}"
        )
    nodes = _nodes(declaration, given)
    return nodes[0] if main.arity == "one" and len(nodes) == 1 else nodes


def _usage(declaration: NodeDeclaration) -> str:
    port = next((port for port in declaration.ports if port.required), None)
    port = port or next(iter(declaration.ports), None)
    return f"{declaration.id}({python_name(port.key)}=…)" if port else f"{declaration.id}()"


def _slot(declaration: NodeDeclaration, slot: SlotDeclaration, value: object) -> Filled:
    if slot.arity != "table":
        nodes = _nodes(declaration, (value,))
        return nodes[0] if slot.arity == "one" and not isinstance(value, list | tuple) else nodes
    if not isinstance(value, Mapping):
        raise TypeError(f"{declaration.id}: {slot.key!r} is a mapping: {slot.doc}")
    table: dict[str, _Part] = {}
    for label, part in cast("Mapping[object, object]", value).items():
        nodes = _nodes(declaration, (part,))
        table[str(label)] = nodes if isinstance(part, list | tuple) else nodes[0]
    return table


def _nodes(declaration: NodeDeclaration, given: Iterable[object]) -> tuple[NodeDescription, ...]:
    found: list[NodeDescription] = []
    for one in given:
        for part in cast("Iterable[object]", one) if isinstance(one, list | tuple) else (one,):
            described = None if isinstance(part, type) else getattr(part, "description", None)
            if not isinstance(described, NodeDescription):
                hint = f"; write {part.__name__}(…)" if isinstance(part, type) else ""
                raise TypeError(f"{declaration.id}: {show(part)} is not a node{hint}")
            found.append(described)
    return tuple(found)


def _slot_subject(slot: SlotDeclaration) -> str:
    if slot.key != "do":
        return f"{slot.key!r} is"
    return "its children are" if slot.arity == "many" else "its child is"


def _filled_value(filled: Filled) -> Value:
    if isinstance(filled, dict):
        return {label: _filled_value(part) for label, part in filled.items()}
    if isinstance(filled, tuple):
        return [node.value() for node in filled]
    return filled.value()


class NodeSignature:
    """Descriptor `__signature__` of node classes: children, ports with their defaults, and conditions."""

    def __get__(self, instance: object, owner: type) -> inspect.Signature:
        declaration: NodeDeclaration | None = getattr(owner, "declaration", None)
        if declaration is None:
            return inspect.signature(owner.__init__)
        return signature_of(declaration)


def signature_of(declaration: NodeDeclaration) -> inspect.Signature:
    """Return the signature of a node's constructor: children, required ports, other ports, conditions."""
    named = inspect.Parameter.KEYWORD_ONLY
    empty = inspect.Parameter.empty
    found: list[inspect.Parameter] = []
    if declaration.slot("do") is not None:
        found.append(inspect.Parameter("children", inspect.Parameter.VAR_POSITIONAL, annotation="Child"))
    for port in sorted(declaration.ports, key=lambda port: not port.required):
        default = empty if port.required else port.default if port.direction == "in" else None
        found.append(
            inspect.Parameter(python_name(port.key), named, default=default, annotation=annotation(port))
        )
    for slot in declaration.slots:
        if slot.key != "do":
            default = empty if slot.required else None
            kind = "Mapping[str, Child]" if slot.arity == "table" else "Child"
            found.append(inspect.Parameter(slot.key, named, default=default, annotation=kind))
    found.append(inspect.Parameter("name", named, default="", annotation="str"))
    found.append(
        inspect.Parameter("conditions", inspect.Parameter.VAR_KEYWORD, annotation="Unpack[Conditions]")
    )
    first = [each for each in found if each.kind is not named or each.default is empty]
    last = first.pop()
    return inspect.Signature([*first, *(each for each in found if each not in (*first, last)), last])


def documented(declaration: NodeDeclaration) -> str:
    """Return the node's docstring with its ports and children: name, meaning, unit, bounds, default."""
    lines = [f"    {python_name(port.key)}: {_port_text(port)}" for port in declaration.ports]
    lines += [f"    {slot.key}: {slot.doc}" for slot in declaration.slots if slot.key != "do"]
    if not lines:
        return declaration.doc
    return "\n".join([declaration.doc, "", "Ports:", *lines, ""])


def _port_text(port: PortDeclaration) -> str:
    parts = [port.doc + (f", {port.unit}" if port.unit else "")]
    if port.direction == "out":
        return f"{parts[0]}. Output: the key to write, as '{{{port.key}}}'."
    if port.within.words():
        parts.append(port.within.words())
    if not port.required and port.default not in ("", None, []):
        parts.append(f"default {port.default}")
    return "; ".join(parts) + "."


_ANNOTATIONS: Final[Mapping[str, str]] = {
    "string": "str", "int": "int | str", "float": "float | str", "bool": "bool | str", "object": "str",
    "expression": "str | bool", "any": "object",
}  # fmt: skip


def annotation(port: PortDeclaration) -> str:
    """Return the type of a port's argument. A text may always be a reference such as `{item}`."""
    if port.direction == "out":
        return "str"
    one = _ANNOTATIONS[port.type.name]
    if port.choices and port.type.name == "string":
        one = f"Literal[{', '.join(map(repr, port.choices))}] | str"
    if port.type.many:
        one = f"Iterable[{one}] | str"
    return f"{one} | None" if port.type.optional else one


MAIN: Final = "Main"
FILE_MODULE: Final = "picktree_plugin_"
"""Beginning of the names under which the files of plug-ins are imported."""
_NO_PLACE: Final = Mark("", 1, 1)
_IN_PYTHON: Final = Mark("mission", 0, 0)


class TreeDefinition:
    """A named tree with typed ports. A call of it is a node: `sort_one(item="{item}")`.

    `ports` has the port's type by name (`"object"`, `"list of float"`), or all that a mission file may say of
    it: `{"type": "float", "unit": "N", "default": 20}`.
    """

    def __init__(self, name: str, root: Described, ports: Mapping[str, object] | None = None) -> None:
        self.name = name
        self.root = root.description
        self.ports = {
            key: plain_value(value, f"port {key!r} of {name}") for key, value in (ports or {}).items()
        }

    def __repr__(self) -> str:
        return f"<tree {self.name}({', '.join(self.ports)})>"

    def describe_call(self, node: type, ports: Mapping[str, object]) -> NodeDescription:
        """Return the description of a call by a node of class `node`.

        Raises TypeError for an unknown port.
        """
        names = {python_name(key): key for key in self.ports}
        for name in ports:
            if name not in (*names, "name") and not name.startswith("_"):
                hint = suggest_name(name, names)
                raise TypeError(f"{self.name} has no port {name!r}" + (f" ({hint})" if hint else ""))
        values = {
            names.get(name, name): plain_value(value, f"port {name!r} of {self.name}")
            for name, value in ports.items()
        }
        return NodeDescription(self.name, node, values, {}, self)

    def value(self) -> Value:
        """Return the tree as a mission file has it."""
        root = self.root.value()
        if not self.ports:
            return root
        return {"ports": dict(self.ports), **(root if isinstance(root, dict) else {str(root): None})}


def trees_of(main: NodeDescription) -> dict[str, CalledTree]:
    """Return the trees that a tree calls, directly or not, by name.

    Raises PicktreeError when two trees have the same name.
    """
    found: dict[str, CalledTree] = {}
    todo = [main]
    while todo:
        for tree in (node.tree for node in todo.pop().iterate() if node.tree is not None):
            known = found.get(tree.name)
            if known is None and tree.name != MAIN:
                found[tree.name] = tree
                todo.append(tree.root)
            elif known is not tree:
                raise PicktreeError(f"two different trees are called {tree.name!r}")
    return found


@dataclass(frozen=True, slots=True)
class MissionSource:
    """Mission made in Python: its main tree and the head of its file."""

    main: TreeDefinition
    """Tree `Main`; its ports are the mission's parameters."""
    name: str
    scene: str | None = None
    goal: str | None = None
    include: tuple[str, ...] = ()

    def classes(self) -> dict[type, None]:
        """Return the classes of all nodes, in order."""
        roots = [self.main.root, *(tree.root for tree in trees_of(self.main.root).values())]
        return {node.node: None for root in roots for node in root.iterate() if node.tree is None}

    def local_classes(self, folder: Path) -> tuple[type, ...]:
        """Return the classes that a file in `folder` cannot name, as those of a notebook's cells."""
        foreign = (node for node in self.classes() if not _is_ours(node))
        return tuple(node for node in foreign if _plugin_name(node, folder) is None)

    def text(self, folder: Path) -> str:
        """Return the text of a mission file in `folder`, with the plug-ins that such a file can name."""
        named = (_plugin_name(node, folder) for node in self.classes() if not _is_ours(node))
        plugins: list[Value] = list(dict.fromkeys(name for name in named if name is not None))
        trees = {MAIN: self.main, **trees_of(self.main.root)}
        data: dict[str, Value] = {"picktree": 1, "kind": "mission", "name": self.name}
        data |= {"scene": self.scene} if self.scene is not None else {}
        data |= {"goal": self.goal} if self.goal is not None else {}
        data |= {"include": list(self.include)} if self.include else {}
        data |= {"plugins": plugins} if plugins else {}
        data["trees"] = {name: tree.value() for name, tree in trees.items()}
        return mission_text(from_value(data, _NO_PLACE))

    def document(self, folder: Path) -> Document:
        """Return the mission as a document in `folder` that is not written there."""
        return read_document(folder / f"{self.name}.yaml", "mission", self.text(folder))

    def save(self, file: Path) -> None:
        """Write the mission file. Raises PicktreeError for a node that no file offers, or a disk that
        refuses."""
        folder = file.absolute().parent
        for node in self.local_classes(folder):
            raise PicktreeError(
                f"{node.__name__} is defined in {_place_of(node)}: a mission file names nodes of modules, "
                f"and of Python files in its folder {folder}, that list them in NODES"
            )
        try:
            file.write_text(self.text(folder), encoding="utf-8")
        except OSError as error:
            raise PicktreeError(f"{file}: the mission cannot be written: {error.strerror}") from None


def python_faults(faults: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Return faults of a mission that was made in Python: their places are paths in the tree, not lines."""
    return tuple(replace(fault, mark=_IN_PYTHON) for fault in faults)


def _is_ours(node: type) -> bool:
    return node.__module__.split(".")[0] == "picktree"


def _plugin_name(node: type, folder: Path) -> str | None:
    """Return the entry under `plugins:` for a node: a file in the mission's folder, else a module.

    None when no such entry leads to the node.
    """
    module = sys.modules.get(node.__module__)
    if module is None or module.__name__ == "__main__" or node not in getattr(module, "NODES", ()):
        return None
    file = Path(module.__file__).resolve() if module.__file__ else None
    beside = file is not None and file.is_relative_to(folder.resolve()) and "site-packages" not in file.parts
    if file is not None and beside:
        return file.relative_to(folder.resolve()).as_posix()
    return None if module.__name__.startswith(FILE_MODULE) else module.__name__


def _place_of(node: type) -> str:
    module = sys.modules.get(node.__module__)
    return str(getattr(module, "__file__", None) or node.__module__)


class DescribedNode(Behaviour):
    """Node as the constructor describes it, before a builder binds it to a running tree."""

    declaration: ClassVar[NodeDeclaration]
    description: NodeDescription
    """Ports and children of a node that was made in Python; a node of a running tree has none."""
    __signature__ = NodeSignature()

    def __init__(self, *children: Child, name: str = "", **ports: Any) -> None:
        """Describe a node in Python, in the terms of a mission file; `bound` makes the nodes that are ticked.

        Raises TypeError for a port that the node does not have, or a missing one.
        """
        super().__init__(name=name or self.declaration.id)
        self.description = describe(
            type(self), self.declaration, children, {"name": name, **ports} if name else ports
        )

    def save(self, file: str | PathLike[str], *, scene: str | None = None, name: str = "") -> None:
        """Write a mission file whose `Main` is the tree below this node, made in Python.

        Raises PicktreeError for a node that no file offers, or a disk that refuses.
        """
        path = Path(file)
        MissionSource(TreeDefinition(MAIN, self), name or path.stem, scene).save(path)

    def __repr__(self) -> str:
        if "description" in vars(self):
            return value_text(from_value(self.description.value(), _NO_PLACE))
        return f"<{type(self).__name__} {self.name}>"
