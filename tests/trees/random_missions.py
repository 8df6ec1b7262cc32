"""Random missions of all the language's nodes, and random cases for them, from a seed."""

from __future__ import annotations

import json
import random
from collections.abc import Sequence
from typing import Any, TypeAlias

Data: TypeAlias = dict[str, Any]

LEAVES = ("Look", "Pick", "Put", "Go", "Retreat", "Weigh", "Ready", "Maybe")
"""Those of `rehearsing`, for which cases answer."""
_OBJECTS = ("o1", "o2")
_EXPRESSIONS = (
    "holding", "not stopped", "number > 1", "text == 'x'", "items_to_do < 2", "any", "object.colour == 'red'",
    "len(objects) > 1 or held_object", "time > 0.2", "true", "object.destination == 'x_bin' and number < 3",
)  # fmt: skip
_WRITTEN: Sequence[Data] = (
    {"SetBlackboard": {"value": 2, "output_key": "{number}"}},
    {"SetBlackboard": {"value": "x", "output_key": "{text}"}},
    {"Look": {"objects": "{objects}"}},
    {"ForEach": {"in": "{objects}", "out": "{object}", "do": "AlwaysSuccess"}},
    {"SetBlackboard": {"value": True, "output_key": "{any}"}},
)
"""What gives the keys their types. It may fail on the way, so that some stay unwritten."""
_PATTERNS = ("grasp.*", "grasp.missed", "safety.*", "tree.*", "*", "world.unknown_object")
_CONDITIONS: dict[str, Sequence[str]] = {
    "_skipIf": _EXPRESSIONS,
    "_while": _EXPRESSIONS,
    "_failureIf": _EXPRESSIONS,
    "_successIf": _EXPRESSIONS,
    "_onSuccess": ("number = 2", "text := 'y'"),
    "_onFailure": ("number = number + 1", "any = true"),
    "_onHalted": ("number = 0",),
    "_post": ("any := false",),
}
_ANSWERS: dict[str, Sequence[str]] = {
    "Look": ("SUCCESS", "RUNNING", "world.unknown_object"),
    "Pick": ("SUCCESS", "RUNNING", "grasp.missed", "grasp.slipped", "safety.force_limit"),
    "Put": ("SUCCESS", "RUNNING", "place.full", "grasp.slipped"),
    "Go": ("SUCCESS", "RUNNING", "safety.stop", "world.unknown_object"),
    "Retreat": ("SUCCESS", "RUNNING", "planning.no_path"),
    "Weigh": ("RUNNING", "perception.stale"),
    "Ready": ("SUCCESS", "FAILURE", "perception.stale"),
    "Maybe": ("SUCCESS", "FAILURE", "SKIPPED", "RUNNING"),
}
_EFFECTS: Sequence[Data] = (
    {"hand": "empty"}, {"hand": "o1"}, {"objects": {"o2": None}}, {"facts": {"holding": True}},
    {"objects": {"o1": {"place": "hand"}}}, {"objects": {"o3": {}}, "facts": {"holding": None}},
)  # fmt: skip


_AROUND = (
    "Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback", "RoundRobin", "Parallel", "IfThenElse",
    "WhileDoElse", "Switch", "ForEach", "Inverter", "ForceSuccess", "ForceFailure", "KeepRunningUntilFailure",
    "Repeat", "RetryUntilSuccessful", "RunOnce", "Timeout", "Delay", "Recover", "RecoveryNode", "ParallelAll",
    "SequenceWithMemory", "PipelineSequence", "RateController", "SkipUnlessUpdated", "WaitValueUpdate",
    "AsyncSequence", "AsyncFallback", "TryCatch",
)  # fmt: skip
_VALUES: Sequence[Data] = (
    {"value": 3, "output_key": "{number}"},
    {"value": "{any}", "output_key": "{any}"},
    {"value": False, "output_key": "{any}"},
    {"value": "{object.colour}", "output_key": "{text}"},
)


class Author:
    """Writes missions and cases; the same seed writes the same."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)

    def mission(self) -> str:
        """The text of a mission; JSON is YAML, too. It need not be without faults."""
        ports: Data = {"item": {"type": "object"}, "n": {"type": "int", "default": 3}}
        if self._one_in(2):
            ports["out"] = {"type": "any", "direction": "out"}
        self._sub_ports = tuple(ports)
        main = self._prepared(self._tree(4, calls=True))
        trees: Data = {"Main": main}
        if '"Sub"' in json.dumps(main):
            trees["Sub"] = {"ports": ports, **self._prepared(self._tree(2, calls=False))}
        return json.dumps({"picktree": 1, "kind": "mission", "trees": trees})

    def _prepared(self, tree: Data) -> Data:
        """The tree after what gives its keys their types."""
        return {"Sequence": [{"ForceSuccess": [self._leaf(calls=False), *_WRITTEN]}, tree]}

    def cases(self, mission: str) -> str:
        """The text of a file with one case for the mission."""
        leaves: Data = {}
        for name in LEAVES:
            if f'"{name}"' in mission and (name == "Weigh" or not self._one_in(3)):
                leaves[name] = [self._answer(name) for _ in range(self._random.randint(1, 3))]
        objects: Data = {"o1": {"colour": "red", "destination": "x_bin"}, "o2": {}}
        case: Data = {
            "objects": {name: entry for name, entry in objects.items() if not self._one_in(4)},
            "leaves": leaves,
            "expect": {"ticks": self._random.randint(5, 40)},
        }
        if self._one_in(5):
            case["halt_after"] = self._random.randint(1, 5)
        return json.dumps({"picktree": 1, "kind": "cases", "cases": {"it": case}})

    def _answer(self, leaf: str) -> Data | str:
        if leaf != "Weigh" and self._one_in(2):
            return self._random.choice(_ANSWERS[leaf])
        answer: Data = {}
        if leaf != "Ready":
            answer["ticks"] = self._random.randint(0, 3)
        if leaf == "Look" and self._one_in(2):
            answer["outputs"] = {"objects": self._random.sample(["o1", "o2", "gone"], 2)}
        if leaf == "Weigh":
            answer["outputs"] = {"weight": self._random.choice([1, "200 mN"]), "sort": "light"}
        if self._one_in(3):
            answer["then"] = self._random.choice(_EFFECTS)
        return answer

    # Trees.

    def _tree(self, depth: int, *, calls: bool) -> Data:
        tree = self._around(depth, calls) if depth and not self._one_in(5) else self._leaf(calls)
        ((_, body),) = tree.items()
        while self._one_in(6):
            name = self._random.choice(list(_CONDITIONS))
            body[name] = self._random.choice(_CONDITIONS[name])
        return tree

    def _leaf(self, calls: bool) -> Data:
        one = self._random.choice([*_OBJECTS, "{object}", "{object}"])
        found: list[Data] = [
            {"Look": self._some(objects="{objects}")},
            {"Pick": {"object": one}},
            {"Put": {"object": one, **self._some(into="{object.destination}")}},
            {"Go": {}},
            {"Retreat": self._some(drop=True)},
            {"Weigh": self._some(weight="{force}", sort="{text}")},
            {"Ready": {}},
            {"Maybe": {}},
            {"AlwaysSuccess": {}},
            {"AlwaysFailure": {}},
            {"Condition": {"if": self._random.choice(_EXPRESSIONS)}},
            {"SetBlackboard": dict(self._random.choice(_VALUES))},
            {"Log": {"message": "here", **self._some(value="{any}")}},
            {"Sleep": {"msec": self._milliseconds()}},
            {"WasEntryUpdated": {"entry": "{any}"}},
        ]
        if calls:
            given = {"n": self._whole(), "out": "{any}"}
            ports = self._some(**{key: value for key, value in given.items() if key in self._sub_ports})
            found += [{"Sub": {"item": one, **ports}}] * 2
        return self._random.choice(found)

    def _around(self, depth: int, calls: bool) -> Data:
        def child() -> Data:
            return self._tree(depth - 1, calls=calls)

        def children(least: int = 1) -> list[Data]:
            return [child() for _ in range(self._random.randint(least, 3))]

        def table(names: Sequence[str]) -> Data:
            return {name: child() for name in self._random.sample(list(names), self._random.randint(1, 2))}

        name = self._random.choice(_AROUND)
        match name:
            case "Parallel":
                parts = children()
                counts = [-1, 1, len(parts), "{number}"]  # of the last it is not known how many it is
                wanted, tolerated = self._random.choice(counts), self._random.choice(counts)
                return {name: {"do": parts, **self._some(success_count=wanted, failure_count=tolerated)}}
            case "ParallelAll":
                parts = children()
                count = self._random.choice([-1, 1, len(parts), "{number}"])
                return {name: {"do": parts, **self._some(max_failures=count)}}
            case "RateController":
                return {name: {"hz": self._random.choice([5, 20, 0.5]), "do": child()}}
            case "SkipUnlessUpdated" | "WaitValueUpdate":
                return {name: {"entry": self._random.choice(["{number}", "{any}"]), "do": child()}}
            case "IfThenElse" | "WhileDoElse":
                return {name: {"do": children(2)}}
            case "TryCatch":
                return {name: {"catch_on_halt": self._one_in(2), "do": children(2)}}
            case "Switch":
                variable, names = self._random.choice([("{number}", ["1", "2"]), ("{text}", ["x", "light"])])
                return {name: {"variable": variable, "cases": table(names), **self._some(default=child())}}
            case "ForEach":
                elements = self._random.choice([[1, 2], [3], "{objects}", []])
                into = "{object}" if elements == "{objects}" else "{number}"
                more = self._some(on_failure="continue", most=self._whole())
                return {name: {"in": elements, "out": into, "do": child(), **more}}
            case "Repeat":
                condition = {"while": self._random.choice(_EXPRESSIONS)}
                return {name: {"num_cycles": self._whole(), "do": child(), **self._some(**condition)}}
            case "RetryUntilSuccessful":
                return {name: {"num_attempts": self._whole(), "do": child()}}
            case "Timeout":
                return {name: {"msec": self._milliseconds(), "do": child()}}
            case "Delay":
                return {name: {"delay_msec": self._milliseconds(), "do": child()}}
            case "RecoveryNode":
                return {name: {"do": [child(), child()], **self._some(number_of_retries=2)}}
            case "Recover":
                more = self._some(otherwise=child(), give_up=child(), attempts="{number}")
                return {name: {"do": child(), "when": table(_PATTERNS), **more}}
            case "Inverter" | "ForceSuccess" | "ForceFailure" | "KeepRunningUntilFailure" | "RunOnce":
                return {name: {"do": child()}}
            case _:
                return {name: {"do": children()}}

    # Values.

    def _one_in(self, n: int) -> bool:
        return self._random.randrange(n) == 0

    def _some(self, **given: object) -> Data:
        return {key: value for key, value in given.items() if self._one_in(2)}

    def _whole(self) -> object:
        return self._random.choice([-1, 1, 2, 2, 3, "{number}"])

    def _milliseconds(self) -> object:
        return self._random.choice([0, 50, 200, "{number}"])
