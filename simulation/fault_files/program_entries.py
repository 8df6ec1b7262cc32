"""What may happen to the program that runs the mission."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

from .occasions import When


@dataclass(frozen=True, slots=True)
class Hang:
    """The skill that runs yields for ever: it is never done, until it is halted."""

    name: ClassVar[str] = "hang"
    when: When


@dataclass(frozen=True, slots=True)
class Raise:
    """The code of the skill that runs raises an exception."""

    name: ClassVar[str] = "raise"
    when: When


@dataclass(frozen=True, slots=True)
class Kill:
    """The process is killed (SIGKILL)."""

    name: ClassVar[str] = "kill"
    when: When


ProgramFault: TypeAlias = Hang | Raise | Kill
