"""BehaviorTree.CPP itself for the import of other people's trees: what it loads, and how it ticks.

The nodes of a file are registered as the file uses them: their ports take any type. The leaves are numbered
in the order of their creation, which no conversion changes, and answer by number, tick and seed.
"""

from __future__ import annotations

import random
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Timer

from picktree.authoring.xml import XmlText

from .btcpp_library import Driver

TICKS = 30
"""Ticks of one comparison."""
PATIENCE = 5.0
"""Time after which a tick counts as one without end, s."""
_OURS = ("ForEach", "RepeatWhile", "CheckExpression", "AssignExpressions", "Guarded")
"""Nodes of ours into which nodes of the library are translated."""
_CRASHED = "crashed"
_FORMAT_3 = ("SequenceStar", "SubTreePlus", "RetryUntilSuccesful", "BlackboardCheckInt",
             "BlackboardCheckDouble", "BlackboardCheckString", "BlackboardCheckBool")  # fmt: skip
_FORBIDDEN = re.compile(r"""[\s&"'/\\:*?|.]""")
_ID = re.compile(r"""(\b(?:ID|main_tree_to_execute)\s*=\s*["'])([^"'<>]*)(["'])""")
_INCLUDE = re.compile(r"<include\b[^>]*>(?:\s*</include>)?")
_TAG = re.compile(
    r"""<!--.*?-->|<(/?)([\w.:-]+)((?:\s+[^\s=<>/]+\s*=\s*(?:"[^"]*"|'[^']*'))*)\s*(/?)>""",
    re.DOTALL,
)
_ATTRIBUTE = re.compile(r"""([^\s=<>/]+)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
_WORDS = ("root", "BehaviorTree", "SubTree", "include", "TreeNodesModel")
_KINDS = ("Action", "Condition", "Control", "Decorator")
_WAYS = ("input_port", "output_port", "inout_port")


@dataclass
class _Used:
    kind: str = "Action"
    ports: dict[str, str] = field(default_factory=dict[str, str])
    """Directions by name."""
    most: int = 0
    declared: bool = False


@dataclass
class _Open:
    name: str
    identity: str
    children: int = 0


class Library:
    """BehaviorTree.CPP in a process of its own, started again where a file crashes it. Use it in a `with`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._driver = Driver()
        self.renamed = False
        """Whether the last files were loaded with other names."""

    def __enter__(self) -> Library:
        return self

    def __exit__(self, *error: object) -> None:
        self._driver.__exit__()

    def refuses(self, files: Sequence[XmlText], main: str) -> str:
        """Load files of others; return why the library refuses them, empty when it does not.

        4.10 forbids blanks and more in names, which earlier versions allow: they are replaced then.
        """
        texts = [_INCLUDE.sub("", file.text) for file in files]
        why, self.renamed = self._refused(texts, main), False
        if "forbidden character" in why:
            self.renamed = True
            texts = [_ID.sub(_plain, text) for text in texts]
            why = self._refused(texts, _FORBIDDEN.sub("_", main))
        return why

    def _refused(self, texts: Sequence[str], main: str) -> str:
        lines: list[str] = []
        for name, used in nodes_of(texts).items():
            lines.append(f"node {used.kind} {name}")
            lines += [f"port {way} {port} BT::AnyTypeAllowed" for port, way in used.ports.items()]
        for index, text in enumerate(texts):
            path = self._folder / f"{index}.xml"
            path.write_text(text, encoding="utf-8")
            lines.append(f"file {path}")
        return self._answer(*lines, f"make {main}")

    def refuses_ours(self, xml: str) -> str:
        """Load XML of ours with the nodes that it declares; return as `refuses` does."""
        try:
            said = self._driver.load(xml, self._folder / "ours.xml")
        except AssertionError:
            said = self._crashed()
        return "" if said == "loaded" else said.removeprefix("refused: ")

    def ticks(self, seed: int) -> list[str]:
        """Tick the loaded tree; return what its leaves did in each tick, and the status of the root."""
        chance, found = random.Random(seed), list[str]()
        for _ in range(TICKS):
            found.append(self._answer("ticks " + "".join(chance.choice("SSSSFFR") for _ in range(500))))
            if found[-1].startswith(("threw", _CRASHED)):
                return [*found[:-1], found[-1].split(" ")[0]]
        return found

    def _answer(self, *lines: str) -> str:
        patience = Timer(PATIENCE, self._driver.kill)
        patience.start()
        try:
            for line in lines[:-1]:
                self._driver.say(line)
            said = self._driver.ask(lines[-1])
        except (AssertionError, BrokenPipeError):
            said = self._crashed()
        finally:
            patience.cancel()
        return "" if said == "loaded" else said.removeprefix("refused: ")

    def _crashed(self) -> str:
        self._driver.__exit__()
        self._driver = Driver()
        return _CRASHED


def _plain(match: re.Match[str]) -> str:
    return match[1] + _FORBIDDEN.sub("_", match[2]) + match[3]


def nodes_of(texts: Sequence[str]) -> Mapping[str, _Used]:
    """Return the nodes that files use or declare, by ID, read so that no fault of a file matters."""
    found: dict[str, _Used] = {}
    for text in texts:
        for inside, above, identity, name, given in _elements(text):
            if inside == "model":
                if name in _KINDS:
                    used = found.setdefault(identity, _Used())
                    used.kind, used.declared = name, True
                elif name in _WAYS and above in found:
                    found[above].ports[given.get("name", "")] = name
            else:
                _use(found, identity, name, given, above)
    for used in found.values():
        if used.most and used.kind not in ("Control", "Decorator"):
            used.kind = "Decorator" if used.most == 1 else "Control"
        elif not used.most and used.kind in ("Control", "Decorator") and not used.declared:
            used.kind = "Action"
    return {name: used for name, used in found.items() if name and name not in _FORMAT_3}


def _use(found: dict[str, _Used], identity: str, name: str, given: Mapping[str, str], above: str) -> None:
    if above in found:
        found[above].most = max(found[above].most, int(given.get("__index", "1")))
    if name == "SubTree":
        return
    used = found.setdefault(identity, _Used())
    used.kind = name if name in _KINDS and not used.declared else used.kind
    for key in given:
        if key not in ("ID", "name", "__index") and not key.startswith("_"):
            used.ports.setdefault(key, "inout_port")


def _elements(text: str) -> Iterator[tuple[str, str, str, str, Mapping[str, str]]]:
    """Yield place, ID above, ID, name and attributes of each element of trees and of the model."""
    above: list[_Open] = []
    place = ""
    for match in _TAG.finditer(text):
        end, name, attributes, alone = match.groups()
        if name is None:
            continue
        if end:
            while above and above.pop().name != name:
                pass
            place = place if name not in ("BehaviorTree", "TreeNodesModel") else ""
            continue
        given = {key: first or second for key, first, second in _ATTRIBUTE.findall(attributes)}
        identity = given.get("ID", name) if name in (*_KINDS, "SubTree") else name
        if name in ("BehaviorTree", "TreeNodesModel"):
            place = "tree" if name == "BehaviorTree" else "model"
        elif place and name not in _WORDS[:1]:
            parent = above[-1] if above else _Open("", "")
            parent.children += 1
            over = parent.identity if parent.name not in ("BehaviorTree", "TreeNodesModel") else ""
            yield place, over, identity, name, {**given, "__index": str(parent.children)}
        if not alone:
            above.append(_Open(name, identity))


def trees_of(text: str) -> list[str]:
    """Return the IDs of a file's trees."""
    return re.findall(r"""<BehaviorTree\b[^>]*?\bID\s*=\s*["']([^"']+)["']""", text)


def called_by(text: str) -> set[str]:
    """Return the IDs of the sub-trees that a file calls."""
    return set(re.findall(r"""<SubTree\b[^>]*?\bID\s*=\s*["']([^"']+)["']""", text))


def comparable(xml: str, texts: Sequence[str]) -> bool:
    """Whether the library ticks the same nodes in our XML: none stands for one of its own that it lacks."""
    theirs, ours = nodes_of(texts), nodes_of([xml])
    return not any(name in ours and name not in theirs for name in _OURS)
