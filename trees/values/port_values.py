"""What a file gives under one node, for rules about several keys and about values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Given:
    """The keys that stand under a node, and what is known of them."""

    keys: frozenset[str]
    constants: Mapping[str, object] = field(default_factory=dict[str, object])
    """The values of inputs that stand there as literals, converted; what comes over a key is not known."""
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    """By slot, one entry a child: its name in a table, else empty."""

    def any_of(self, *keys: str) -> bool:
        """Whether at least one of these keys is given."""
        return not self.keys.isdisjoint(keys)

    def number(self, key: str) -> float | None:
        """The number that stands there as a literal; None when there is none."""
        value = self.constants.get(key)
        return value if isinstance(value, int | float) and not isinstance(value, bool) else None


@dataclass(frozen=True, slots=True)
class Misfit:
    """What is wrong with the value of one key; `key` may be `slot/label`."""

    key: str
    message: str
    hint: str = ""
