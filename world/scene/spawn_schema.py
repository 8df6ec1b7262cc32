"""Grammar of the items' supply in scene files: spawn areas and feeds."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, Strict, WithJsonSchema

from ...files.value_wording import describe, suggest_name
from ...files.yaml.field_types import Duration, FileModel, Flag, InvalidValue, Share, quantity
from ..colours import ITEM_COLOURS
from .body_schema import Corner


def _item_colour(name: str) -> str:
    if name not in ITEM_COLOURS:
        raise InvalidValue(
            f"{describe(name)} is no colour that an item may have",
            suggest_name(name, ITEM_COLOURS),
            code="P108",
        )
    return name


def _clear(value: object) -> object:
    """Validate a time of a load; `clear` becomes None."""
    if isinstance(value, str) and value != "clear":
        hint = "it is clear, {every: 45 s} or {at: [10 s, 60 s]}"
        raise InvalidValue(f"{describe(value)} is no time for a load", hint, code="P108")
    return None if value == "clear" else value


ItemColour = Annotated[str, AfterValidator(_item_colour), WithJsonSchema({"enum": list(ITEM_COLOURS)})]
Count = Annotated[int, Strict(), Field(ge=1, le=200)]
Spacing = Annotated[float, quantity("m", least=0.01, most=10)]
Period = Annotated[float, quantity("s", least=1, most=86400)]
Total = Annotated[int, Strict(), Field(ge=1, le=1_000_000)]


class AreaFile(FileModel):
    """A rectangle on the table, along the world's axes, for the items' centres."""

    min: Corner
    """Smallest x and y in the world."""
    max: Corner
    """Greatest x and y in the world."""


class SpawnFile(FileModel):
    """Items that are set down at random where a run begins; where, follows from scene and seed alone."""

    of: Annotated[dict[str, Count], Field(min_length=1)]
    """How many of each kind of the catalogue."""
    colours: Annotated[tuple[ItemColour, ...], Field(min_length=1)]
    """Given out in turn, shuffled: with three colours a third of the items has each."""
    area: AreaFile
    """Where on the table."""
    gap: Annotated[float, quantity("m", least=0, most=1)] = 0.025
    """Free distance between any two items as seen from above."""
    lying: Share = 0.0
    """Share of the cylinders that lie on their side."""
    tumbled: Flag = False
    """Dropped from 10 cm in any orientation instead of set down: items roll, and lean on one another."""
    touching: Flag = False
    """Set down side by side, so that each touches another; most of them face to face. Then `gap` is only kept
    from other entries' items. Not beside `tumbled`."""


class WhenFile(FileModel):
    """The times at which a load comes."""

    one_of: ClassVar[tuple[str, ...]] = ("every", "at")
    """Exactly one of these is given."""

    every: Period | None = None
    """Time from one load to the next; the first comes after the same time."""
    at: Annotated[tuple[Duration, ...], Field(min_length=1)] | None = None
    """Simulated times since the run began, ascending."""


class FeedFile(FileModel):
    """Items that are brought while a run goes on: loads on the table, or single items on a belt."""

    one_of: ClassVar[tuple[str, ...]] = ("area", "belt")
    """Exactly one of these is given."""

    of: Annotated[dict[str, Count], Field(min_length=1)]
    """How many of each kind of the catalogue are in one load; for a belt the shares of a mixture."""
    colours: Annotated[tuple[ItemColour, ...], Field(min_length=1)]
    """Given out in turn, shuffled."""
    area: AreaFile | None = None
    """Where on the table a load is set down, wherever it is free. Either this or `belt`."""
    belt: str | None = None
    """The belt, by its name under `fixtures`, at whose upstream end items are set down one by one."""
    gap: Annotated[float, quantity("m", least=0, most=1)] | None = None
    """Free distance on the table to any other item as seen from above; 25 mm unless given."""
    lying: Share = 0.0
    """Share of the cylinders that lie on their side."""
    tumbled: Flag | None = None
    """Dropped on the table from 10 cm in any orientation instead of set down."""
    when: Annotated[
        WhenFile | None, BeforeValidator(_clear, json_schema_input_type=Literal["clear"] | WhenFile | None)
    ] = None
    """Time of the loads: `clear` (unless given), which is when the robot reports that it is done with what
    lies there, `{every: 45 s}` or `{at: [10 s, 60 s]}`. A belt runs whenever the robot is ready."""
    spacing: Spacing | None = None
    """Mean distance on a belt from one item to the next; 150 mm unless given."""
    total: Total | None = None
    """How many items come in all; without it they come for ever."""
