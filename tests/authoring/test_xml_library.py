"""BehaviorTree.CPP itself loads and ticks what is written, where its library is installed."""

from __future__ import annotations

import json
import random
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import cast

import pytest
from hypothesis import given, settings

from picktree.authoring.xml import mission_to_xml
from picktree.files import FileError
from picktree.files.yaml import read_document
from picktree.trees import AUTOREMAP, Mission
from picktree.trees.loading import NodeRegistry, examine, parse_mission

from ..trees.scripted import FILE
from .btcpp_library import LIBRARY, Driver
from .btcpp_rules import complaints
from .test_xml_round_trip import FILES
from .wild_leaves import NODES as WILD
from .wild_missions import wild_mission
from .xml_missions import missions, parsed


@pytest.fixture(scope="module")
def driver() -> Iterator[Driver]:
    LIBRARY.require()
    with Driver() as started:
        yield started


def loaded(driver: Driver, mission: Mission, folder: Path) -> str:
    """What the library says to the mission's XML; the codes of the faults where it cannot travel."""
    try:
        xml = mission_to_xml(mission)
    except FileError as error:
        assert all(fault.code and fault.mark.line and fault.message for fault in error.faults)
        return " ".join(sorted({fault.code for fault in error.faults}))
    said = driver.load(xml, folder / "tree.xml")
    # The rules written by hand judge as the library does.
    assert (said == "loaded") == (complaints(xml) == []), (said, complaints(xml))
    return said


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_examples_and_library_load(path: Path, driver: Driver, tmp_path: Path) -> None:
    assert (
        loaded(driver, examine(read_document(path, "mission"), NodeRegistry()).mission, tmp_path) == "loaded"
    )


# Random missions of everything that reads and writes keys through the ports of sub-trees.

_LITERALS: dict[str, tuple[object, ...]] = {
    "int": (0, 2, -1, 7, 3_000_000_000, 10**12, 2**53 + 1), "float": (0, 3, 0.5, -2.5, 1e-7, 1e300),
    "ms": (0, 600, "1.5 s", "600 ms", 20.0),
    "string": ("", "red", "operator's bin", "3", "1e5", "a;b", "true", "3 ms"),
    "bool": (True, False), "list of int": ([], [1], [1, 2]), "list of float": ([], [0.5], [1, 2.5]),
    "list of string": ([], ["3"], ["a", "b;c"]), "object": ("red_1", "7"), "any": (1, 2.5, "x", None, True),
}  # fmt: skip
_FITS: dict[str, tuple[str, ...]] = {
    "int": ("int",), "float": ("float", "int", "ms"), "ms": ("ms",), "string": ("string",),
    "bool": ("bool",), "object": ("object", "string"), "any": tuple(_LITERALS),
    "list of string": ("list of string",), "list of int": ("list of int",),
    "list of float": ("list of float",),
}  # fmt: skip


class TypedAuthor:
    """Writes missions whose values pass through typed ports of sub-trees; not all are without faults."""

    def __init__(self, seed: int) -> None:
        self._chance = random.Random(seed)
        self._trees: dict[str, dict[str, str]] = {}
        self._main = self._kinds()

    def _kinds(self) -> dict[str, str]:
        """Some keys, each with its type."""
        return {f"p{i}": self._chance.choice(list(_LITERALS)) for i in range(self._chance.randint(1, 4))}

    def mission(self) -> dict[str, object]:
        trees: dict[str, object] = {}
        for name in ("Inner", "Outer", "Main"):
            kinds = self._main if name == "Main" else self._kinds()
            ports = {key: self._port(kind, name) for key, kind in kinds.items()}
            children = [self._node(kinds) for _ in range(self._chance.randint(1, 4))]
            trees[name] = {"ports": ports, "Sequence": children}
            self._trees[name] = kinds
        return {"picktree": 1, "kind": "mission", "trees": trees}

    def _port(self, kind: str, tree: str) -> dict[str, object]:
        port: dict[str, object] = {"type": "float", "unit": "ms"} if kind == "ms" else {"type": kind}
        if self._chance.random() < 0.5 or tree == "Main":
            port["default"] = self._chance.choice(_LITERALS[kind])
        return port

    def _value(self, kind: str, keys: dict[str, str]) -> object:
        shared = self._chance.random() < 0.15
        known = {f"@{key}": other for key, other in self._main.items()} if shared else keys
        fitting = [key for key, other in known.items() if other in _FITS[kind]]
        if fitting and self._chance.random() < 0.8:
            return "{" + self._chance.choice(fitting) + "}"
        return self._chance.choice(_LITERALS[kind])

    def _node(self, keys: dict[str, str]) -> dict[str, object]:
        def value(kind: str) -> object:
            return self._value(kind, keys)

        leaf = "AlwaysSuccess"
        made: list[dict[str, object]] = [
            {"Delay": {"delay_msec": value("ms"), "do": leaf}},
            {"Timeout": {"msec": value("ms"), "do": leaf}},
            {"Repeat": {"num_cycles": value("int"), "do": leaf}},
            {"Repeat": {"num_cycles": value("int"), "while": "items_left", "do": leaf}},
            {"RetryUntilSuccessful": {"num_attempts": value("int"), "do": leaf}},
            {"Sleep": {"msec": value("ms")}},
            {"RateController": {"hz": value("float"), "do": leaf}},
            {"ParallelAll": {"max_failures": value("int"), "do": [leaf]}},
            {"SequenceWithMemory": [leaf, leaf]},
            {"PipelineSequence": [leaf, leaf]},
            {
                self._chance.choice(("SkipUnlessUpdated", "WaitValueUpdate")): {
                    "entry": value("any"),
                    "do": leaf,
                }
            },
            {"WasEntryUpdated": {"entry": value("any")}},
            {"Script": {"code": self._chance.choice(("q := 1", "@q := 'x'; r := 2.5", "q := p0; q += 1"))}},
            {"RunOnce": {"then_skip": value("bool"), "do": leaf}},
            {"Switch": {"variable": value(self._chance.choice(("string", "int"))), "cases": {"3": leaf}}},
            {"ForEach": {"in": value("list of int"), "out": "{each}", "most": value("int"), "do": leaf}},
            {"Take": {"object": value("object"), "force": value("float"), "colour": value("string")}},
            {"Find": {"ids": value("list of string"), "found": "{seen}"}},
            {"Log": {"message": value("string"), "value": value("any")}},
        ]
        for name, ports in self._trees.items():
            call = {key: value(kind) for key, kind in ports.items() if self._chance.random() < 0.9}
            remapped: dict[str, object] = {AUTOREMAP: True} if self._chance.random() < 0.3 else {}
            made += [cast("dict[str, object]", {name: {**remapped, **call}})] * 6
        return self._chance.choice(made)


def test_random_missions_load_or_say_what_cannot_travel(driver: Driver, tmp_path: Path) -> None:
    said: list[str] = []
    for seed in range(250):
        said.append(loaded(driver, parsed_wild(seed), tmp_path))
    seed = 0
    while len(said) < 500:
        seed += 1
        with suppress(FileError):  # what `check` refuses is no matter of XML
            said.append(loaded(driver, parsed(json.dumps(TypedAuthor(seed).mission())), tmp_path))
    counts = Counter(said)
    assert set(counts) <= {"loaded", "P923", "P925", "P926", "P923 P925", "P923 P926", "P925 P926"}, counts
    assert counts["loaded"] > 400, counts


def parsed_wild(seed: int) -> Mission:
    return parse_mission(wild_mission(seed), FILE, NodeRegistry(WILD, installed=False))


@given(missions())
@settings(max_examples=60)
def test_any_mission_loads(text: str) -> None:
    LIBRARY.require()
    with Driver() as driver, TemporaryDirectory() as folder:
        assert loaded(driver, parsed(text), Path(folder)) in ("loaded", "P925", "P926")
