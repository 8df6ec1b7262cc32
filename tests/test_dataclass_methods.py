"""Methods of dataclasses made from closures: each does what the compiled one does."""

from __future__ import annotations

import dataclasses
import math
from types import ModuleType
from typing import Any

import pytest

from picktree.world.values import Pose

CLASSES = """
from __future__ import annotations
from dataclasses import dataclass, field

@dataclass(frozen=True)
class Empty: ...

@dataclass(frozen=True, slots=True)
class Single:
    x: object

@dataclass(frozen=True)
class Several:
    x: object
    hidden: object = field(default=0, repr=False)
    beside: object = field(default=0, compare=False)

@dataclass(frozen=True)
class Derived(Several):
    y: object = 1

class Loose(Several):
    pass

@dataclass(order=True)
class Ordered:
    x: object
    y: object = 0

@dataclass(frozen=True, eq=False, repr=False)
class Bare:
    x: object
"""


def classes(module: str) -> ModuleType:
    """Module with these classes, which are made as those of a module with this name are."""
    made = ModuleType(module)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(__import__("sys").modules, module, made)
        exec(CLASSES, vars(made))
    return made


OURS, THEIRS = classes("picktree.made_for_a_test"), classes("made_for_a_test")
INFINITE: list[Any] = []
INFINITE.append(INFINITE)
VALUES = [
    ("Empty", ()),
    ("Single", (1,)),
    ("Single", ("1",)),
    ("Single", (math.nan,)),
    ("Several", (1, 2, 3)),
    ("Several", (1, 2, 4)),
    ("Several", (1, 3, 3)),
    ("Several", (INFINITE,)),
    ("Derived", (1, 2, 3, 4)),
    ("Derived", (1, 2, 3, 5)),
    ("Loose", (1, 2, 3)),
    ("Ordered", (1, 2)),
    ("Bare", (1,)),
]


def outcome(action: Any) -> object:
    """What an action returns, or how it fails."""
    try:
        return action()
    except Exception as error:  # noqa: BLE001 - any kind is to be the same
        return type(error), str(error)


def behaviour(module: ModuleType) -> list[object]:
    made = [getattr(module, name)(*values) for name, values in VALUES]
    seen: list[object] = [[a == b for a in made] for b in made]
    seen += [outcome(lambda a=a: a != 3 and a == 3) for a in made]
    seen += [repr(a) for a in made if type(a).__name__ != "Bare"]
    seen += [outcome(lambda a=a: hash(a)) for a in made if type(a).__name__ != "Bare"]
    for a in made:
        for name in ("x", "hidden", "new"):
            seen.append(outcome(lambda a=a, name=name: setattr(a, name, 7)))
            seen.append(outcome(lambda a=a, name=name: delattr(a, name)))
    seen.append(outcome(lambda: made[-2] < module.Ordered(1, 3)))
    owner = module.Single([])
    owner.x.append(owner)
    seen += [repr(owner), dataclasses.asdict(module.Several(1)), repr(dataclasses.replace(made[4], x=9))]
    methods = [getattr(module.Several, name) for name in ("__eq__", "__hash__", "__repr__", "__setattr__")]
    seen += [(method.__name__, method.__qualname__) for method in methods]
    return seen


def test_our_classes_behave_as_all_others() -> None:
    assert behaviour(OURS) == behaviour(THEIRS)


def test_only_our_classes_have_these_methods() -> None:
    compiled = "<string>"
    assert THEIRS.Several.__eq__.__code__.co_filename == compiled
    assert THEIRS.Several.__setattr__.__code__.co_filename == compiled
    for name in ("__eq__", "__hash__", "__setattr__", "__delattr__"):
        for kind in (OURS.Several, Pose):
            assert getattr(kind, name).__code__.co_filename != compiled
    assert OURS.Several.__init__.__code__.co_filename == compiled
    assert OURS.Ordered.__lt__.__code__.co_filename == compiled
