"""What BehaviorTree.CPP 4 demands of an XML file before it makes a tree of it, written down independently.

After `VerifyXML`, `createNodeFromXML`, `recursivelyCreateSubtree` and the grammar of scripts in its sources
(4.7 to 4.10). The nodes of TreeNodesModel count as registered, as a program does it that runs the file.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

FORBIDDEN = re.compile(r"[\x00-\x1f\x7f <>&\"'/\\:*?|.]")
RESERVED = (
    "ID", "name", "_autoremap", "_failureIf", "_successIf", "_skipIf", "_while",
    "_onHalted", "_onFailure", "_onSuccess", "_post",
)  # fmt: skip
SCRIPTS = RESERVED[3:]


@dataclass(frozen=True)
class Node:
    """What is registered: the kind, and the ports with their C++ types."""

    kind: str
    ports: Mapping[str, str] = field(default_factory=dict[str, str])


def _controls(*names: str) -> dict[str, Node]:
    return {name: Node("Control") for name in names}


def _decorators(*names: str) -> dict[str, Node]:
    return {name: Node("Decorator") for name in names}


ANY = "BT::AnyTypeAllowed"
BUILT_IN: dict[str, Node] = {
    **_controls("Sequence", "Fallback", "AsyncSequence", "AsyncFallback", "SequenceWithMemory"),
    **_controls("ReactiveSequence", "ReactiveFallback", "IfThenElse", "WhileDoElse"),
    "Parallel": Node("Control", {"success_count": "int", "failure_count": "int"}),
    "ParallelAll": Node("Control", {"max_failures": "int"}),
    **{
        f"Switch{n}": Node(
            "Control", {"variable": "std::string", **{f"case_{i}": "std::string" for i in range(1, n + 1)}}
        )
        for n in range(2, 7)
    },
    **_decorators("Inverter", "KeepRunningUntilFailure", "ForceSuccess", "ForceFailure"),
    "TryCatch": Node("Control", {"catch_on_halt": "bool"}),
    **{name: Node("Decorator", {"entry": ANY}) for name in ("SkipUnlessUpdated", "WaitValueUpdate")},
    "WasEntryUpdated": Node("Action", {"entry": ANY}),
    "RetryUntilSuccessful": Node("Decorator", {"num_attempts": "int"}),
    "Repeat": Node("Decorator", {"num_cycles": "int"}),
    "Timeout": Node("Decorator", {"msec": "unsigned"}),
    "Delay": Node("Decorator", {"delay_msec": "unsigned"}),
    "RunOnce": Node("Decorator", {"then_skip": "bool"}),
    "Precondition": Node("Decorator", {"if": "std::string", "else": "NodeStatus"}),
    **{
        f"Loop{kind}": Node("Decorator", {"queue": ANY, "if_empty": "NodeStatus", "value": ANY})
        for kind in ("Int", "Bool", "Double", "String")
    },
    "AlwaysSuccess": Node("Action"),
    "AlwaysFailure": Node("Action"),
    "Script": Node("Action", {"code": "std::string"}),
    "ScriptCondition": Node("Condition", {"code": "std::string"}),
    "SetBlackboard": Node("Action", {"value": ANY, "output_key": ANY}),
    "UnsetBlackboard": Node("Action", {"key": "std::string"}),
    "Sleep": Node("Action", {"msec": "unsigned"}),
    "SubTree": Node("SubTree"),
}


def complaints(text: str) -> list[str]:
    """Why BehaviorTree.CPP would refuse the file; empty when it would not."""
    judge = _Judge(ET.fromstring(text))
    return [*judge.all(), *judge.made()]


@dataclass
class _Board:
    """A blackboard while trees are made: the types of its entries, and keys that are the caller's."""

    types: dict[str, str] = field(default_factory=dict[str, str])
    outer: _Board | None = None
    remapped: dict[str, str] = field(default_factory=dict[str, str])

    def find(self, key: str) -> tuple[_Board, str]:
        if key.startswith("@"):
            return self.outer.find(key) if self.outer is not None else (self, key[1:])
        if key in self.types or self.outer is None or key not in self.remapped:
            return self, key
        return self.outer.find(self.remapped[key])


def _stored(text: str) -> str:
    """The type of a literal of a sub-tree's port, from 4.9.1 on."""
    if re.fullmatch(r"-?\d+", text, re.ASCII) and abs(int(text)) < 2**63:
        return "int" if -(2**31) <= int(text) < 2**31 else "long"
    number = re.fullmatch(r"-?((\d+\.?\d*|\.\d+)(e[-+]?\d+)?|inf|infinity|nan)", text.lower(), re.ASCII)
    return "double" if number else "std::string"


class _Judge:
    def __init__(self, root: ET.Element) -> None:
        self.root = root
        self.trees = {tree.get("ID", ""): tree for tree in root.findall("BehaviorTree")}
        self.nodes = dict(BUILT_IN)
        self.models: dict[str, ET.Element] = {}

    def all(self) -> Iterator[str]:
        if self.root.tag != "root" or self.root.get("BTCPP_format") != "4":
            yield "no <root> of format 4"
        yield from self.model()
        main = self.root.get("main_tree_to_execute")
        if main is not None and main not in self.trees:
            yield f"main_tree_to_execute: no tree {main}"
        for tree in self.root.findall("BehaviorTree"):
            yield from self.tree(tree)

    def model(self) -> Iterator[str]:
        found = self.root.findall("TreeNodesModel")
        if len(found) > 1:
            yield "several <TreeNodesModel>"
        for element in (model for part in found for model in part):
            identity = element.get("ID", "")
            yield from self.name(identity, "model")
            if element.tag == "SubTree":
                self.models[identity] = element
                continue
            if element.tag not in ("Action", "Condition", "Control", "Decorator"):
                yield f"<{element.tag}> in the models"
            if identity in self.nodes:
                yield f"{identity} is registered twice"
            ports: dict[str, str] = {}
            for port in element:
                yield from self.port_name(port.get("name", ""))
                ports[port.get("name", "")] = port.get("type", ANY)
            self.nodes[identity] = Node(element.tag, ports)

    def name(self, name: str, what: str) -> Iterator[str]:
        if not name or name in ("Root", "root") or FORBIDDEN.search(name):
            yield f"{what}: {name!r} is no name"

    def port_name(self, name: str) -> Iterator[str]:
        if not name[:1].isalpha() or FORBIDDEN.search(name) or name in RESERVED:
            yield f"{name!r} is not the name of a port"

    def tree(self, tree: ET.Element) -> Iterator[str]:
        identity = tree.get("ID", "")
        yield from self.name(identity, "tree")
        if identity in self.nodes:
            yield f"the tree {identity} has the name of a node"
        if len(tree) != 1:
            yield f"the tree {identity} has {len(tree)} children"
        self.instances: set[str] = set()
        for child in tree:
            yield from self.node(child)

    def node(self, element: ET.Element) -> Iterator[str]:
        explicit = element.tag in ("Action", "Condition", "Control", "Decorator", "SubTree")
        identity = element.get("ID", "") if explicit else element.tag
        if not explicit and element.get("ID") is not None:
            yield f"<{element.tag} ID>"
        if any(ord(c) < 32 and c not in "\t\n\r" for c in element.get("name", "")):
            yield "a control character in a name"
        yield from self.scripts(element)
        if element.tag == "SubTree":
            yield from self.subtree(element, identity)
            return
        if identity not in self.nodes:
            yield f"Node not recognized: {identity}"
            return
        node = self.nodes[identity]
        count = len(element)
        if node.kind == "Decorator" and count != 1:
            yield f"{identity} must have exactly 1 child"
        if node.kind == "Control" and count == 0:
            yield f"{identity} must have 1 or more children"
        if node.kind in ("Action", "Condition") and count:
            yield f"{identity} must not have any child"
        if (switch := re.fullmatch(r"Switch(\d+)", identity)) and count != int(switch[1]) + 1:
            yield f"{identity} has {count} children"
        if identity in ("IfThenElse", "WhileDoElse") and count not in (2, 3):
            yield f"{identity} has {count} children"
        if identity == "ReactiveSequence":
            yield from (f"Unknown node type: {c.tag}" for c in element if c.tag not in self.nodes)
        yield from self.ports(element, node)
        for child in element:
            yield from self.node(child)

    def ports(self, element: ET.Element, node: Node) -> Iterator[str]:
        for key, value in element.attrib.items():
            if not key[:1].isalpha() or key in RESERVED:
                continue
            if key not in node.ports:
                yield f"a port with name [{key}] is found in <{element.tag}>"
                continue
            if not _pointer(value) and not _converts(value, node.ports[key]):
                yield f"[{key}] with value [{value}] can not be converted to {node.ports[key]}"

    # The types of keys, as trees are made.

    def made(self) -> Iterator[str]:
        for name in ["Main"] if "Main" in self.trees else self.trees:
            yield from self.make(self.trees[name], _Board(), 0)

    def make(self, element: ET.Element, board: _Board, depth: int) -> Iterator[str]:
        if depth > 300:
            return
        for child in element:
            if child.tag == "SubTree":
                below = self.board(child, board)
                if child.get("ID") in self.trees:
                    yield from self.make(self.trees[child.get("ID", "")], below, depth + 1)
                continue
            node = self.nodes.get(child.tag, Node("Action"))
            for key, value in child.attrib.items():
                if key in node.ports and _pointer(value):
                    yield from self.entry(board, value.strip(" ")[1:-1], node.ports[key])
            yield from self.make(child, board, depth)

    def board(self, call: ET.Element, outer: _Board) -> _Board:
        given = {
            key: value for key, value in call.attrib.items() if key[:1].isalpha() and key not in RESERVED
        }
        model = self.models.get(call.get("ID", ""), ())
        given = {
            port.get("name", ""): port.get("default", "") for port in model if port.get("default")
        } | given
        board = _Board(outer=outer)
        for key, value in given.items():
            if _pointer(value):
                board.remapped[key] = value.strip(" ")[1:-1]
            else:
                board.types[key] = _stored(value)
        return board

    def entry(self, board: _Board, key: str, kind: str) -> Iterator[str]:
        """The first type of an entry is decisive, unless it is a text."""
        kind = kind.replace("ObjectId", "std::string")
        board, key = board.find(key)
        first = board.types.setdefault(key, kind)
        if ANY not in (kind, first) and first not in (kind, "std::string"):
            yield f"[{key}] is {first}, and later {kind}"

    def subtree(self, element: ET.Element, identity: str) -> Iterator[str]:
        yield from self.name(identity, "SubTree")
        if len(element):
            yield f"<SubTree {identity}> has children"
        if identity in self.nodes:
            yield f"<SubTree {identity}> has the name of a node"
        if identity not in self.trees:
            yield f"Can't find a tree with name: {identity}"
        instance = element.get("name")
        if instance is not None:
            if instance in self.instances:
                yield f"Duplicate SubTree path detected: {instance}"
            self.instances.add(instance)
        model = self.models.get(identity)
        if model is None or element.get("_autoremap") in ("true", "1"):
            return
        for port in model:
            if (
                port.tag.endswith("_port")
                and not port.get("default")
                and port.get("name") not in element.attrib
            ):
                yield f"{identity} is defining a mandatory port called [{port.get('name')}]"

    def scripts(self, element: ET.Element) -> Iterator[str]:
        found = [element.get(key, "") for key in SCRIPTS if key in element.attrib]
        if element.tag in ("Script", "ScriptCondition"):
            found.append(element.get("code", ""))
        yield from (f"Error in the script {script!r}" for script in found if not parses(script))


def _pointer(value: str) -> bool:
    bare = value.strip(" ")
    return len(bare) >= 3 and bare[0] == "{" and bare[-1] == "}"


def _converts(value: str, kind: str) -> bool:
    if kind == "int":
        return re.fullmatch(r"-?\d+", value) is not None and abs(int(value)) < 2**31
    if kind == "unsigned":
        return re.fullmatch(r"\d+", value) is not None and int(value) < 2**32
    if kind.startswith("std::vector<") and kind != "std::vector<std::string>" and value.startswith("json:"):
        return False  # 4.7 cannot read it
    if kind == "double":
        return re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", value) is not None
    if kind == "bool":
        return value in ("0", "1", "true", "True", "TRUE", "false", "False", "FALSE")
    if kind == "NodeStatus":
        return value in ("IDLE", "RUNNING", "SUCCESS", "FAILURE", "SKIPPED")
    return True


# The grammar of scripts, by the levels of lexy's operators, from what binds loosest to what binds tightest.

SPACE = r"[ \t\n\r]*"
ATOMS = re.compile(
    r"""(?P<boolean>true|false)|(?P<name>[A-Za-z_@]\w*)|(?P<text>'[\x00-\x26\x28-\x7f]*'|"[\x00-\x21\x23-\x7f]*")
    |(?P<number>0[xX][0-9a-fA-F]+|[0-9]+(\.[0-9]+)?([eE][-+]?[0-9]+)?)(?![.A-Za-z_])""",
    re.VERBOSE | re.ASCII,
)


class _Bad(Exception):
    pass


def parses(script: str) -> bool:
    """Whether the grammar of scripts takes the text."""
    try:
        return _Script(script).whole()
    except _Bad:
        return False


class _Script:
    def __init__(self, text: str) -> None:
        self.text, self.at = text, 0
        self.space()

    def space(self) -> None:
        found = re.compile(SPACE).match(self.text, self.at)
        assert found is not None
        self.at = found.end()

    def take(self, *symbols: str) -> str:
        """The longest of the symbols that stands here, else nothing."""
        for symbol in sorted(symbols, key=len, reverse=True):
            if self.text.startswith(symbol, self.at):
                self.at += len(symbol)
                self.space()
                return symbol
        return ""

    def looks(self, *symbols: str) -> bool:
        return any(self.text.startswith(symbol, self.at) for symbol in symbols)

    def whole(self) -> bool:
        self.assignment()
        while self.take(";"):
            if self.at < len(self.text):
                self.assignment()
        return self.at == len(self.text)

    def assignment(self) -> None:
        self.conditional()
        if not self.looks("==") and self.take(":=", "=", "+=", "-=", "*=", "/="):
            self.conditional()

    def conditional(self) -> None:
        self.logical()
        if self.take("?"):
            self.assignment()
            if self.looks(":=") or not self.take(":"):
                raise _Bad
            self.logical()

    def logical(self) -> None:
        self.comparison()
        while self.take("||", "&&"):
            self.comparison()

    def comparison(self) -> None:
        self.group()
        while self.take("==", "!=", "<=", ">=", "<", ">"):
            self.group()

    def group(self) -> None:
        """Arithmetic, or bits and `!`, or joined texts; not mixed without brackets."""
        if self.looks("~") or (self.looks("!") and not self.looks("!=")):
            self.bits()
            return
        self.product()
        while not self.looks("+=", "-=") and self.take("+", "-"):
            self.product()
        if self.looks("&&", "||"):
            return
        if self.take("&", "|", "^"):
            self.bits()
        elif self.take(".."):
            self.group()

    def bits(self) -> None:
        self.take("~", "!")
        self.atom()
        while not self.looks("&&", "||") and self.take("&", "|", "^"):
            self.take("~", "!")
            self.atom()
        if self.looks("+", "-", "*", "/"):
            raise _Bad

    def product(self) -> None:
        self.take("-")
        self.atom()
        while not self.looks("*=", "/=") and self.take("*", "/"):
            self.take("-")
            self.atom()

    def atom(self) -> None:
        if self.take("("):
            self.assignment()
            if not self.take(")"):
                raise _Bad
            return
        found = ATOMS.match(self.text, self.at)
        if found is None:
            raise _Bad
        self.at = found.end()
        # `true` is taken before a name that begins with it.
        if found["boolean"] and re.compile(r"\w", re.ASCII).match(self.text, self.at):
            raise _Bad
        self.space()
