"""Renaming of trees, keys and nodes whose names a mission cannot have, with a note about each.

BehaviorTree.CPP takes any text for the name of a tree, a node or a key.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

from picktree.files import Mark
from picktree.trees import IDENTIFIER, MAIN, POSTCONDITIONS, PRECONDITIONS, references
from picktree.trees.loading import NodeRegistry
from picktree.world import world_facts

from . import btcpp_vocabulary
from .element import Element
from .literal_text import is_pointer
from .scripts import OUR_WORDS, names_in, with_names
from .source import ImportFaults, XmlSource

MAX_NAME_LENGTH = 60
_KEY_PORTS = ("output_key", "entry", "key")
"""Ports of BehaviorTree.CPP's own nodes that take the name of a key without braces."""
_CALL_WORDS = ("ID", "name")


def identifier(text: str, taken: Collection[str] = (), fallback: str = "key") -> str:
    """Return an identifier of ASCII letters similar to the text, and not among `taken`."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    stem = re.sub(r"\W+", "_", plain, flags=re.ASCII).strip("_") or fallback
    stem = f"_{stem}" if stem[0].isdigit() else stem
    stem = stem[: MAX_NAME_LENGTH - 4]
    name, number = stem, 1
    while name in taken:
        number += 1
        name = f"{stem}_{number}"
    return name


def node_name(text: str) -> str:
    """Return a valid name for a node of a mission."""
    name = " ".join(re.sub(r"[/#]+", "-", text).split())
    name = name if len(name) <= MAX_NAME_LENGTH else name[: MAX_NAME_LENGTH - 1].rstrip() + "…"
    return name.strip("- ") or "node"


def rename_trees(source: XmlSource, registry: NodeRegistry, faults: ImportFaults) -> None:
    """Give each tree its name in the mission."""
    for old in (*source.trees, *source.included):
        if old == source.main or (IDENTIFIER.fullmatch(old) and _free(old, registry, source)):
            source.names[old] = MAIN if old == source.main else old
    for old, tree in source.trees.items():
        if old in source.names:
            continue
        taken = {*source.trees, *source.names.values(), MAIN}
        new = identifier(old, taken, "Tree")
        if registry.find(new) is not None or btcpp_vocabulary.taken(new):
            new = identifier(f"{new}_tree", taken, "Tree")
        source.names[old] = new
        faults.note(
            tree.place("ID"), "root", f"the tree {old!r} is called {new!r} in the mission", code="P917"
        )


def _free(name: str, registry: NodeRegistry, source: XmlSource) -> bool:
    return name in source.included or (name != MAIN and registry.find(name) is None)


def rename_keys(source: XmlSource, faults: ImportFaults) -> None:
    """Rename the keys that a mission cannot have, in all trees and models at once."""
    used: dict[str, Mark] = {}
    scripted: set[str] = set()
    for root in (*source.trees.values(), *source.models.values()):
        for element in root.iterate():
            for key, mark in _keys(element):
                used.setdefault(key, mark)
            for attribute in _scripts(element):
                found = names_in(element.get(attribute))
                scripted.update(found)
                for name in _assigned(element.get(attribute), found):
                    used.setdefault(name, element.place(attribute))
    words = {name.lstrip("@") for name in scripted}
    wrong = [key for key in used if _is_wrong(key, words)]
    wrong += [name for name in OUR_WORDS if name in words and name not in used]
    if not wrong:
        return
    taken = {*used, *words, *world_facts.FACTS, *OUR_WORDS}
    names: dict[str, str] = {}
    for key in wrong:
        stem = f"{key}_key" if IDENTIFIER.fullmatch(key) else key
        new = names[key] = identifier(stem, taken)
        taken.add(new)
        mark = used.get(key) or source.root.mark
        faults.note(mark, "", f"the key {key!r} is called {new!r} in the mission", code="P917")
    source.trees = {name: _renamed(tree, names) for name, tree in source.trees.items()}
    source.models = {name: _renamed_model(model, names) for name, model in source.models.items()}


def _is_wrong(key: str, scripted: Collection[str]) -> bool:
    stem, *attributes = key.split(".")
    if IDENTIFIER.fullmatch(stem) and attributes:
        return not all(attribute in references.ATTRIBUTES for attribute in attributes)
    if not IDENTIFIER.fullmatch(key):
        return True
    return key in world_facts.FACTS or (key in OUR_WORDS and key in scripted)


def _keys(element: Element) -> Iterator[tuple[str, Mark]]:
    """Yield the keys that an element names outside of scripts."""
    if element.name in ("input_port", "output_port", "inout_port"):
        yield element.get("name"), element.place("name")
    for attribute, text in element.attributes.items():
        mark = element.place(attribute)
        if element.name == "SubTree" and attribute not in _CALL_WORDS and not attribute.startswith("_"):
            yield attribute, mark
        if _is_key(element, attribute):
            yield text.strip("{}"), mark
        elif _is_reference(element, attribute, text):
            yield text.strip(" ")[1:-1].removeprefix("@"), mark


def _is_key(element: Element, attribute: str) -> bool:
    own = element.identity in btcpp_vocabulary.BUILT_IN
    return own and attribute in _KEY_PORTS and bool(element.get(attribute).strip("{} "))


def _is_reference(element: Element, attribute: str, text: str) -> bool:
    if attribute in _CALL_WORDS or not is_pointer(text) or attribute in _scripts(element):
        return False
    return not text.strip(" ").startswith("{=")


def _scripts(element: Element) -> tuple[str, ...]:
    """Return the attributes that hold scripts."""
    if element.identity in btcpp_vocabulary.OURS:
        return ()
    ports: dict[str, tuple[str, ...]] = {
        "Script": ("code",),
        "ScriptCondition": ("code",),
        "Precondition": ("if",),
    }
    known = (*PRECONDITIONS, *POSTCONDITIONS, *ports.get(element.identity, ()))
    return tuple(key for key in known if key in element.attributes)


def _assigned(script: str, names: Collection[str]) -> Iterator[str]:
    for name in names:
        if re.search(rf"(?<![\w@.]){re.escape(name)}\s*[-:+*/]?=(?!=)", script):
            yield name.lstrip("@")


def _renamed(element: Element, names: Mapping[str, str]) -> Element:
    attributes: dict[str, str] = {}
    places: dict[str, Mark] = {}
    scripts = _scripts(element)
    for attribute, text in element.attributes.items():
        key, value = attribute, text
        if element.name == "SubTree" and attribute not in _CALL_WORDS:
            key = names.get(attribute, attribute)
        if attribute in scripts:
            value = with_names(text, names)
        elif _is_key(element, attribute):
            bare = text.strip("{}")
            value = text.replace(bare, names.get(bare, bare))
        elif _is_reference(element, attribute, text):
            bare = text.strip(" ")[1:-1]
            root = "@" if bare.startswith("@") else ""
            value = f"{{{root}{names.get(bare[len(root) :], bare[len(root) :])}}}"
        attributes[key] = value
        places[key] = element.place(attribute)
    children = tuple(_renamed(child, names) for child in element.children)
    return replace(element, attributes=attributes, places=places, children=children)


def _renamed_model(model: Element, names: Mapping[str, str]) -> Element:
    ports = tuple(
        replace(port, attributes={**port.attributes, "name": names.get(port.get("name"), port.get("name"))})
        if "name" in port.attributes
        else port
        for port in model.children
    )
    return replace(model, children=ports)
