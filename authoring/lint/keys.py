"""Keys of a tree as bits, and the possible values of an expression over keys."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain

from picktree.files import Expression, expression_syntax
from picktree.trees import MAIN, NodeSpec, TreeSpec, control_flow, data_flow, references


class KeyUsage:
    """Keys of one tree, with the places of the text that read and write them."""

    def __init__(self, tree: TreeSpec, trees: Mapping[str, TreeSpec]) -> None:
        self.reads: dict[str, list[data_flow.KeyUse]] = {}
        self.writes: dict[str, list[data_flow.KeyUse]] = {}
        for spec in tree.root.iterate():
            for use in data_flow.uses_of(spec, trees):
                self._add(use.key, use)
            for use in _read_inside(spec, trees):
                self._add(use.key, use)
        for other in trees.values() if tree.name == MAIN else ():
            for use in (use for spec in other.root.iterate() for use in data_flow.uses_of(spec, trees)):
                if use.key.startswith(references.ROOT_KEY):
                    self._add(use.key[1:], use)

    def _add(self, key: str, use: data_flow.KeyUse) -> None:
        (self.writes if use.writes else self.reads).setdefault(key, []).append(use)


def _read_inside(spec: NodeSpec, trees: Mapping[str, TreeSpec]) -> Iterator[data_flow.KeyUse]:
    """Yield the keys at outputs of a sub-tree that reads them, too, by itself or further below."""
    tree = trees.get(spec.id) if spec.node is None else None
    for port in tree.ports if tree is not None else ():
        bound = spec.ports.get(port.key)
        if tree is not None and port.direction == "out" and isinstance(bound, references.Reference):
            below = (use for each in tree.root.iterate() for use in data_flow.uses_of(each, trees))
            inside = (use for each in tree.root.iterate() for use in _read_inside(each, trees))
            if any(use.key == port.key and not use.writes for use in chain(below, inside)):
                yield data_flow.KeyUse(spec, port.key, bound.key, port, writes=False)


@dataclass(frozen=True, slots=True)
class KeyBits:
    """Bits of one tree. An instance of a sub-tree keeps its keys from one activation to the next. So each use
    of a sub-tree has its own region of bits: the shifted layout."""

    tree: TreeSpec
    keys: Mapping[str, int]
    flags: Mapping[int, tuple[int, ...]]
    """Flags of nodes that keep a state beyond their end, by `id` of the spec."""
    calls: Mapping[int, tuple[int, KeyBits]]
    """Shift and layout of each use of a sub-tree, by `id` of the spec."""
    size: int
    inputs: int
    rooted: int
    """Bits of keys that other trees write, too; the times of these writes are not tracked."""
    usage: KeyUsage


def lay_out(trees: Mapping[str, TreeSpec], order: tuple[str, ...]) -> dict[str, KeyBits]:
    """Return the layouts of all trees; `order`: each tree after those that it uses."""
    layouts: dict[str, KeyBits] = {}
    for name in order:
        tree = trees[name]
        keys: dict[str, int] = {}
        usage = KeyUsage(tree, trees)
        used = (use for key in (usage.reads, usage.writes) for uses in key.values() for use in uses)
        named = {use.key[1:] for use in used if name == MAIN and use.key.startswith(references.ROOT_KEY)}
        for key in (*(port.key for port in tree.ports), *usage.reads, *usage.writes):
            keys.setdefault(key, 1 << len(keys))
        size = len(keys)
        flags: dict[int, tuple[int, ...]] = {}
        calls: dict[int, tuple[int, KeyBits]] = {}
        for spec in tree.root.iterate():
            if spec.node is None:
                calls[id(spec)] = (size, layouts[spec.id])
                size += layouts[spec.id].size
            else:
                flow = spec.node.declaration.flow
                lasting = (
                    2 if isinstance(flow, control_flow.Once) else int(isinstance(flow, control_flow.Turns))
                )
                lasting = (
                    len(spec.children)
                    if isinstance(flow, control_flow.Resumed | control_flow.Pipeline)
                    else lasting
                )
                flags[id(spec)] = tuple(1 << size + index for index in range(lasting))
                size += lasting
        inputs = sum(keys[port.key] for port in tree.ports if port.direction == "in")
        named |= {port.key for port in tree.ports if port.remapped and port.direction == "out"}
        rooted = sum(bit for key, bit in keys.items() if key.startswith(references.ROOT_KEY) or key in named)
        layouts[name] = KeyBits(tree, keys, flags, calls, size, inputs, rooted, usage)
    return layouts


@dataclass(frozen=True, slots=True)
class ExpressionShape:
    """Properties of an expression.

    `certain`: names that are read for any values. `total`: it has a value for values of any type. `constant`:
    its truth value if independent of the names; else None.
    """

    names: tuple[str, ...]
    certain: frozenset[str]
    attributes: bool
    total: bool
    constant: bool | None
    fails: bool
    """Whether it never has a value, as `1 / 0`."""
    if_yes: bool | None
    """Value of the fact `holding` where the expression holds; None: unknown."""
    if_no: bool | None
    """Value of the fact `holding` where the expression does not hold; None: unknown."""


def shape(expression: Expression) -> ExpressionShape:
    constant, fails = None, False
    if not (
        expression.names
        or any(
            isinstance(part, expression_syntax.Attribute) for part in expression_syntax.walk(expression.root)
        )
    ):
        try:
            constant = bool(expression.evaluate({}))
        except expression_syntax.ExpressionError:
            fails = True
    names = dict.fromkeys(
        part.name
        for part in expression_syntax.walk(expression.root)
        if isinstance(part, expression_syntax.Name)
    )
    return ExpressionShape(
        tuple(names),
        certain_names(expression.root),
        bool(expression.paths),
        is_total(expression.root),
        constant,
        fails,
        implied_holding(expression.root, answer=True),
        implied_holding(expression.root, answer=False),
    )


def certain_names(part: expression_syntax.Part) -> frozenset[str]:
    """Return the names that are read for any values: not those behind a first `and` or `or`."""
    match part:
        case expression_syntax.Name(name=name):
            return frozenset((name,))
        case expression_syntax.Logic(parts=(first, *_)):
            return certain_names(first)
        case expression_syntax.Conditional(test=test, yes=yes, no=no):
            return certain_names(test) | (certain_names(yes) & certain_names(no))
        case expression_syntax.ComparisonChain(first=first, rest=(second, *_)):
            return certain_names(first) | certain_names(second.operand)
        case _:
            return frozenset[str]().union(*map(certain_names, expression_syntax.children(part)))


def is_total(part: expression_syntax.Part) -> bool:
    """Whether all its operations accept any types."""
    match part:
        case expression_syntax.LiteralValue() | expression_syntax.Name():
            return True
        case expression_syntax.ComparisonChain(rest=rest):
            return all(r.relation in ("==", "!=") for r in rest) and all(
                map(is_total, expression_syntax.children(part))
            )
        case (
            expression_syntax.Logic()
            | expression_syntax.Not()
            | expression_syntax.Conditional()
            | expression_syntax.ListOf()
        ):
            return all(map(is_total, expression_syntax.children(part)))
        case _:
            return False


def implied_holding(part: expression_syntax.Part, *, answer: bool) -> bool | None:
    """Return whether an object is held when the expression has that truth value; None: unknown."""
    match part:
        case expression_syntax.Name(name="holding"):
            return answer
        case expression_syntax.Not(operand=operand):
            return implied_holding(operand, answer=not answer)
        case expression_syntax.Logic(symbol=symbol, parts=parts) if (symbol == "and") is answer:
            # All parts of an `and` that holds do, and no part of an `or` that does not.
            known = (implied_holding(one, answer=answer) for one in parts)
            return next((each for each in known if each is not None), None)
        case _:
            return None
