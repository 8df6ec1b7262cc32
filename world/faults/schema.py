"""The grammar of faults files: one model for each kind of entry."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, Strict

from ..colours import ITEM_COLOURS
from ..files.checked import Duration, FileModel, Mass, Wrong, describe, quantity
from ..files.nearest import nearest
from ..scene.description import Form


def _colour(name: str) -> str:
    if name not in ITEM_COLOURS:
        message = f"{describe(name)} is no colour that an item may have"
        raise Wrong(message, nearest(name, ITEM_COLOURS), code="P108")
    return name


def _pattern(text: str) -> str:
    if not text.strip("/"):
        raise Wrong("the node is empty", "its name, or a path as SortOne/Grasp", code="P606")
    return text


Speed = Annotated[float, quantity("m/s", least=-10, most=10)]
Spin = Annotated[float, quantity("rad/s", least=-100, most=100)]


class WhenFile(FileModel):
    at: Duration | None = None
    node: Annotated[str, AfterValidator(_pattern)] | None = None
    start: Annotated[int, Strict(), Field(ge=1)] | None = None
    delay: Duration | None = None


class TargetFile(FileModel):
    index: Annotated[int, Strict(), Field(ge=0)] | None = None
    kind: str | None = None
    form: Form | None = None
    colour: Annotated[str, AfterValidator(_colour)] | None = None
    nearest_to: Literal["tool", "object"] | None = None


class FaultEntryFile(FileModel):
    fault: Literal["remove", "friction", "bump"]
    when: WhenFile
    target: TargetFile
    friction: Annotated[float, quantity("", least=0, most=2)] | None = None
    mass: Mass | None = None
    velocity: tuple[Speed, Speed, Speed] | None = None
    spin: tuple[Spin, Spin, Spin] | None = None


class FaultsRestFile(FileModel):
    """What stands in a faults file beside its list."""

    scene: str | None = None
