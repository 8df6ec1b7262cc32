"""One element of an XML file, with its places."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from ....files.marks import Mark
from .btcpp_vocabulary import ELEMENTS

NOWHERE: Final = Mark("", 1, 1)


@dataclass(frozen=True, slots=True)
class Element:
    """`text` is what stands between the tags beside children, `comments` what stands before the element.

    Two elements are equal when they say the same, wherever they stand.
    """

    name: str
    attributes: Mapping[str, str] = field(default_factory=dict[str, str])
    children: tuple[Element, ...] = ()
    text: str = ""
    comments: tuple[str, ...] = field(default=(), compare=False)
    mark: Mark = field(default=NOWHERE, compare=False)
    places: Mapping[str, Mark] = field(default_factory=dict[str, Mark], compare=False)
    """Where the values of the attributes stand."""

    def get(self, attribute: str, default: str = "") -> str:
        return self.attributes.get(attribute, default)

    @property
    def identity(self) -> str:
        """The ID of the node that the element stands for: its name, or in the explicit form its ID."""
        return self.get("ID") if self.name in ELEMENTS else self.name

    def place(self, attribute: str) -> Mark:
        """Where the attribute's value stands; of one that is not there, the element's place."""
        return self.places.get(attribute, self.mark)

    def all(self, name: str) -> tuple[Element, ...]:
        """The children of that name."""
        return tuple(child for child in self.children if child.name == name)

    def iterate(self) -> Iterator[Element]:
        """This element and all below it, parents first."""
        yield self
        for child in self.children:
            yield from child.iterate()
