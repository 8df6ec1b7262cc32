"""Random small missions over the whole vocabulary, each from a seed."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Mapping
from typing import TypeAlias, cast

from picktree.trees import AUTOREMAP
from picktree.trees.references import ROOT_KEY

PATTERNS = (
    "grasp.*",
    "grasp.missed",
    "control.*",
    "safety.*",
    "tree.*",
    "tree.missing_input",
    "planning.*",
    "*",
)
KEYS = ("a", "b", "c", "d")
LISTS = ("l", "m")
EXPRESSIONS = (
    "items_left", "not holding", "true", "false", "a == 1", "b != 2", "c > 0", "a == 1 or d == 2",
    "items_left and b == 0", "time > 0.1", "1 > 2", "items_to_do > 0", "a == 1 if holding else b == 1",
)  # fmt: skip
ROOTED = ("@a == 1", "c > 0 and @b != 2")
"""Expressions over keys of Main."""
_SHARED = "Shared"
"""Beginning of the names of trees that are called with `_autoremap`."""
_Json: TypeAlias = object


class Writer:
    """Writes trees of at most so many nodes."""

    def __init__(
        self, chance: random.Random, subtrees: Mapping[str, tuple[str, ...]], *, rooted: bool
    ) -> None:
        self._chance = chance
        self._subtrees = subtrees
        self._rooted = 0.15 if rooted else 0.0
        """Share of names that are keys of Main."""
        self._left = chance.randrange(4, 16)
        self._controls: tuple[Callable[[int], _Json], ...] = (
            *(self._listed(name) for name in ("Sequence", "Sequence", "Fallback", "Fallback")),
            *(self._listed(name) for name in ("ReactiveSequence", "ReactiveFallback", "Muddle")),
            *(self._listed(name) for name in ("SequenceWithMemory", "PipelineSequence")),
            *(self._listed(name) for name in ("AsyncSequence", "AsyncFallback")),
            self._try_catch, self._try_catch, self._watching, self._rated, self._parallel_all,
            *(self._wrapped(name) for name in ("Inverter", "ForceSuccess", "ForceFailure")),
            self._wrapped("KeepRunningUntilFailure"),
            self._repeat, self._retry, self._timed, self._once, self._for_each, self._for_each,
            self._branches, self._branches, self._switch, self._parallel, self._parallel, self._turns,
            self._recover, self._recover, self._recovery_node,
        )  # fmt: skip

    def node(self, depth: int = 0) -> _Json:
        self._left -= 1
        write = self._leaf if depth > 4 or self._left <= 0 else self._any(self._controls + (self._leaf,) * 6)
        return self._conditioned(write(depth))

    def _any(self, choices: tuple[Callable[[int], _Json], ...]) -> Callable[[int], _Json]:
        return self._chance.choice(choices)

    def _with(self, share: float) -> bool:
        return self._chance.random() < share

    def _key(self) -> str:
        return _reference(self._name())

    def _name(self) -> str:
        """A key of the tree, or one of Main."""
        return f"{ROOT_KEY if self._with(self._rooted) else ''}{self._chance.choice(KEYS)}"

    def _expression(self) -> str:
        return self._chance.choice(ROOTED if self._with(self._rooted) else EXPRESSIONS)

    def _assignment(self) -> str:
        value = self._name() if self._with(0.5) else self._chance.choice(("0", "1"))
        return f"{self._name()} {self._chance.choice((':=', ':=', '='))} {value}"

    def _leaf(self, _: int) -> _Json:
        if self._subtrees and self._with(0.2):
            return self._call()
        match self._chance.randrange(15):
            case 0 | 1:
                ports = {"value": self._key()} if self._with(0.4) else {}
                return {"Do": {**ports, **({"out": self._key()} if self._with(0.7) else {})}}
            case 2 | 3:
                return {
                    "SetBlackboard": {
                        "value": self._chance.choice((0, 1, self._key())),
                        "output_key": self._key(),
                    }
                }
            case 4:
                return {"Log": {"message": "x", "value": self._key()}}
            case 5:
                return {"Condition": {"if": self._expression()}}
            case 6:
                return {"Ask": {"value": self._key()} if self._with(0.5) else {}}
            case 7:
                return self._chance.choice(("Hold", "Drop", "Stop"))
            case 8:
                return self._chance.choice(("AlwaysSuccess", "AlwaysFailure"))
            case 9:
                return {
                    "SetBlackboard": {"value": [1, 2], "output_key": _reference(self._chance.choice(LISTS))}
                }
            case 10:
                return self._chance.choice(("Hold", "Drop", {"AlwaysSuccess": {"_skipIf": "true"}}))
            case 11:
                return {"WasEntryUpdated": {"entry": self._key()}}
            case 12:
                code = [self._assignment() for _ in range(self._chance.choice((1, 1, 2)))]
                return {"Script": {"code": "; ".join(code)}}
            case 13:
                return {"Sleep": {"msec": self._chance.choice((0, 50, 100))}}
            case _:
                return "Whim"

    def _call(self) -> _Json:
        name = self._chance.choice(tuple(self._subtrees))
        shared = name.startswith(_SHARED)
        ports: dict[str, _Json] = {AUTOREMAP: True} if shared else {}
        for port_ in self._subtrees[name]:
            if shared and self._with(0.5):
                continue
            if port_.startswith("in") or self._with(0.8):
                ports[port_] = self._key() if port_.startswith("out") or self._with(0.7) else 1
        return {name: ports}

    def _conditioned(self, node: _Json) -> _Json:
        if not self._with(0.15):
            return node
        whole: dict[str, _Json] = {node: {}} if isinstance(node, str) else cast("dict[str, _Json]", node)
        ((identity, body),) = whole.items()
        given = dict(cast("dict[str, _Json]", body)) if isinstance(body, dict) else {"do": body}
        for name in ("_skipIf", "_failureIf", "_successIf", "_while"):
            if self._with(0.25):
                given[name] = self._expression()
        for name in ("_onSuccess", "_onFailure", "_post", "_onHalted"):
            if self._with(0.2):
                given[name] = self._assignment()
        return {str(identity): given}

    def _children(self, depth: int, least: int = 1, most: int = 4) -> list[_Json]:
        return [self.node(depth + 1) for _ in range(self._chance.randint(least, most))]

    def _listed(self, name: str) -> Callable[[int], _Json]:
        return lambda depth: {name: self._children(depth)}

    def _wrapped(self, name: str) -> Callable[[int], _Json]:
        return lambda depth: {name: {"do": self.node(depth + 1)}}

    def _repeat(self, depth: int) -> _Json:
        ports: dict[str, _Json] = {}
        if self._with(0.6):
            ports["num_cycles"] = self._chance.choice((-1, 0, 1, 2, 3))
        if not ports or self._with(0.5):
            ports["while"] = self._expression()
        return {"Repeat": {**ports, "do": self.node(depth + 1)}}

    def _retry(self, depth: int) -> _Json:
        attempts = self._chance.choice((-1, 1, 2, 3))
        return {"RetryUntilSuccessful": {"num_attempts": attempts, "do": self.node(depth + 1)}}

    def _timed(self, depth: int) -> _Json:
        name, key = self._chance.choice((("Timeout", "msec"), ("Delay", "delay_msec")))
        return {name: {key: self._chance.choice((0, 50, 100, 200)), "do": self.node(depth + 1)}}

    def _once(self, depth: int) -> _Json:
        return {"RunOnce": {"then_skip": self._with(0.5), "do": self.node(depth + 1)}}

    def _for_each(self, depth: int) -> _Json:
        ports: dict[str, _Json] = {"in": self._chance.choice(([], [1], [1, 2], [0, 1, 2], "{l}", "{m}"))}
        if self._with(0.8):
            ports["out"] = self._key()
        if self._with(0.6):
            ports["on_failure"] = self._chance.choice(("continue", "fail"))
        if self._with(0.3):
            ports["most"] = self._chance.choice((-1, 1, 2))
        return {"ForEach": {**ports, "do": self.node(depth + 1)}}

    def _branches(self, depth: int) -> _Json:
        return {self._chance.choice(("IfThenElse", "WhileDoElse")): self._children(depth, 2, 3)}

    def _switch(self, depth: int) -> _Json:
        cases = {str(value): self.node(depth + 1) for value in range(self._chance.randint(1, 2))}
        body: dict[str, _Json] = {
            "variable": self._chance.choice((0, 1, 2, self._key(), self._key())),
            "cases": cases,
        }
        if self._with(0.5):
            body["default"] = self.node(depth + 1)
        return {"Switch": body}

    def _parallel(self, depth: int) -> _Json:
        parts = self._children(depth, 1, 4)
        ports: dict[str, _Json] = {}
        if self._with(0.5):
            ports["success_count"] = self._count(len(parts))
        if self._with(0.5):
            ports["failure_count"] = self._count(len(parts))
        return {"Parallel": {**ports, "do": parts}}

    def _parallel_all(self, depth: int) -> _Json:
        parts = self._children(depth, 1, 4)
        ports: dict[str, _Json] = {"max_failures": self._count(len(parts))} if self._with(0.5) else {}
        return {"ParallelAll": {**ports, "do": parts}}

    def _try_catch(self, depth: int) -> _Json:
        ports: dict[str, _Json] = {"catch_on_halt": self._with(0.5)} if self._with(0.7) else {}
        return {"TryCatch": {**ports, "do": self._children(depth, 2)}}

    def _watching(self, depth: int) -> _Json:
        name = self._chance.choice(("SkipUnlessUpdated", "WaitValueUpdate"))
        return {name: {"entry": self._key(), "do": self.node(depth + 1)}}

    def _rated(self, depth: int) -> _Json:
        return {"RateController": {"hz": self._chance.choice((5, 10, 100)), "do": self.node(depth + 1)}}

    def _count(self, total: int) -> int:
        return self._chance.randint(1, total) * self._chance.choice((1, 1, -1))

    def _turns(self, depth: int) -> _Json:
        return {"RoundRobin": {"wrap_around": self._with(0.5), "do": self._children(depth)}}

    def _recover(self, depth: int) -> _Json:
        body: dict[str, _Json] = {"do": self.node(depth + 1)}
        if self._with(0.8):
            body["attempts"] = self._chance.randint(1, 4)
        patterns = self._chance.sample(PATTERNS, self._chance.randint(0, 3))
        if patterns:
            body["when"] = {pattern: self.node(depth + 1) for pattern in patterns}
        if not patterns or self._with(0.3):
            body["otherwise"] = self.node(depth + 1)
        if self._with(0.3):
            body["give_up"] = self.node(depth + 1)
        return {"Recover": body}

    def _recovery_node(self, depth: int) -> _Json:
        body = {"number_of_retries": self._chance.randint(0, 3), "do": self._children(depth, 2, 2)}
        return {"RecoveryNode": body}


def wild_mission(seed: int) -> str:
    """The text of a mission with up to three sub-trees, which may use those after them."""
    chance = random.Random(seed)
    rooted = chance.random() < 0.4
    trees: dict[str, _Json] = {}
    known: dict[str, tuple[str, ...]] = {}
    for index in range(chance.choice((0, 0, 1, 2, 3))):
        ports = chance.sample(("in_a", "in_b", "out_a", "out_b"), chance.randrange(4))
        # Inside, a port is one of the keys that every tree uses, so that it is read and written.
        named = {port_: f"{port_[:-1]}{chance.choice(KEYS)}" for port_ in ports}
        declared = {
            name: {"type": "any", "direction": name.split("_")[0]} for name in dict.fromkeys(named.values())
        }
        body = Writer(chance, dict(known), rooted=rooted).node()
        name = f"{_SHARED if chance.random() < 0.3 else 'Tree'}{index}"
        text = json.dumps(body)
        for key in declared:
            # An input must not be written: only what reads becomes a reader of the port.
            places = (
                ('"value": ', '"variable": ')
                if key.startswith("in")
                else ('"value": ', '"out": ', '"output_key": ')
            )
            for place in places:
                if chance.random() < 0.8:
                    text = text.replace(
                        place + json.dumps(_reference(key[-1])), place + json.dumps(_reference(key))
                    )
        trees[name] = {"ports": declared, **_with_all_written(json.loads(text), chance)}
        known[name] = tuple(declared)
    main = _with_all_written(Writer(chance, known, rooted=rooted).node(), chance)
    return json.dumps({"picktree": 1, "kind": "mission", "trees": {"Main": main, **trees}})


def _with_all_written(root: _Json, chance: random.Random) -> Mapping[str, _Json]:
    """The tree with a branch that writes all keys: one that nothing in its tree writes is refused."""
    writes = [{"SetBlackboard": {"value": 1, "output_key": _reference(key)}} for key in KEYS]
    writes += [{"SetBlackboard": {"value": [1], "output_key": _reference(key)}} for key in LISTS]
    branch = {"Sequence": chance.sample(writes, len(writes))}
    return {chance.choice(("Fallback", "Fallback", "Sequence", "Parallel", "RoundRobin")): [root, branch]}


def _reference(key: str) -> str:
    return "{" + key + "}"
