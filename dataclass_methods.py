"""Methods of picktree's dataclasses as closures, because CPython 3.11 compiles each of them from text.

A frozen dataclass has six generated methods. Compiling them for the 500 classes of a run takes 0.2 s of CPU,
a quarter of the start. Only `__init__` gains from it: here the others are functions over the fields' names,
with the same results and errors. Classes of other packages, and other versions of Python, are left alone.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any, Final, TypeAlias

_PACKAGE: Final = f"{__package__}."
_Fields: TypeAlias = "Sequence[dataclasses.Field[Any]]"
_Method: TypeAlias = Callable[..., Any]


def install() -> None:
    """Let `dataclasses.dataclass` make these methods, for classes that are defined from now on."""
    if sys.version_info[:2] != (3, 11):
        return
    for name, ours in _MAKERS.items():
        made: Callable[..., Any] = getattr(dataclasses, name)
        setattr(dataclasses, name, _chosen(made, ours))


def _chosen(made: Callable[..., Any], ours: Callable[..., Any]) -> Callable[..., Any]:
    """Return the maker of a method: ours for the modules of picktree, else the one of `dataclasses`."""

    def maker(*arguments: Any, **named: Any) -> Any:
        *others, namespace = (*arguments, *named.values())
        found = ours(*others) if str(namespace.get("__name__")).startswith(_PACKAGE) else None
        return made(*others, namespace) if found is None else found

    return maker


def _values(names: Sequence[str]) -> Callable[[object], tuple[Any, ...]]:
    """Return a function for the tuple of these attributes of an object."""
    if len(names) > 1:
        return attrgetter(*names)
    return lambda owner: tuple(getattr(owner, name) for name in names)


def _frozen(cls: type, fields: _Fields) -> tuple[_Method, _Method]:
    names = frozenset(field.name for field in fields)

    def __setattr__(self: Any, name: str, value: object) -> None:  # noqa: N807
        if type(self) is cls or name in names:
            raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")
        super(cls, self).__setattr__(name, value)

    def __delattr__(self: Any, name: str) -> None:  # noqa: N807
        if type(self) is cls or name in names:
            raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")
        super(cls, self).__delattr__(name)

    return __setattr__, __delattr__


def _repr(fields: _Fields) -> _Method:
    names = [field.name for field in fields]

    def __repr__(self: Any) -> str:  # noqa: N807
        shown = ", ".join(f"{name}={getattr(self, name)!r}" for name in names)
        return f"{self.__class__.__qualname__}({shown})"

    recursive: Callable[[_Method], _Method] = getattr(dataclasses, "_recursive_repr")  # noqa: B009
    return recursive(__repr__)


def _equal(name: str, operator: str, own: str, other: str) -> _Method | None:
    """Return `__eq__` for the fields in `own`, such as "(self.x,self.y,)"; None for other comparisons."""
    if name != "__eq__":
        return None
    values = _values([part.removeprefix("self.") for part in own.strip("()").split(",") if part])

    def __eq__(self: Any, other: object) -> bool:  # noqa: N807
        return values(self) == values(other) if other.__class__ is self.__class__ else NotImplemented

    return __eq__


def _hash(fields: _Fields) -> _Method:
    values = _values([field.name for field in fields])

    def __hash__(self: Any) -> int:  # noqa: N807
        return hash(values(self))

    return __hash__


_MAKERS: Final[dict[str, Callable[..., Any]]] = {
    "_frozen_get_del_attr": _frozen,
    "_repr_fn": _repr,
    "_cmp_fn": _equal,
    "_hash_fn": _hash,
}
"""Our makers by the names that theirs have in `dataclasses` of CPython 3.11; the last argument is missing."""
