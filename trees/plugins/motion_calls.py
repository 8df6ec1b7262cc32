"""Calls of motions in plug-ins without `yield from`, which do nothing: found in the source, and as they
happen.

A motion is a generator. Called alone, it is made and thrown away, and Python says nothing of it.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import CodeType, GeneratorType
from typing import Final, cast

from .plugin_import import PluginError

_GENERATORS = ("Doing", "Steps", "Generator", "Iterator")
"""Return types of functions that do nothing before they are iterated."""
_HELPER: Final = "__picktree_carried_out__"
_PACKAGE = Path(__file__).resolve().parents[2]
_WORLD = _PACKAGE / "skill_world" / "world.py"


class UnstartedMotion(TypeError):
    """A generator that was thrown away before it was started."""


def check_motion_calls(source: bytes, module: Mapping[str, object], plugin: str) -> None:
    """Check a plug-in's source. Raises PluginError for a motion that is surely called without `yield from`.

    `module`: names of the executed module. What cannot be known before a run is left to `compiled`.
    """
    found = list(_Check(ast.parse(source), module).lost())
    if not found:
        return
    first, *others = found
    message = (
        f"the plug-in {plugin!r}, line {first.line}: {first.where} calls {first.motion} without "
        "'yield from', so that it does nothing"
    )
    if others:
        message += f"; line{'s' if len(others) > 1 else ''} {', '.join(str(o.line) for o in others)}, too"
    raise PluginError(message, f"write 'yield from {first.motion}(…)'", code="P261")


def compiled(source: bytes, path: Path) -> CodeType:
    """Compile a plug-in's file so that a motion which is thrown away raises UnstartedMotion at its line."""
    tree = _Watch(path.name).visit(compile(source, str(path), "exec", ast.PyCF_ONLY_AST))
    return compile(ast.fix_missing_locations(tree), str(path), "exec")


def watched_names() -> dict[str, object]:
    """Return the names that code from `compiled` needs."""
    return {_HELPER: _carried_out}


def _carried_out(value: object, motion: str, place: str) -> object:
    if _is_unstarted(value):
        raise UnstartedMotion(f"{motion} is called without 'yield from', so that it does nothing ({place})")
    return value


def _is_unstarted(value: object) -> bool:
    if type(value) is not GeneratorType:
        return False
    return inspect.getgeneratorstate(cast("Generator[object, object, object]", value)) == inspect.GEN_CREATED


class _Watch(ast.NodeTransformer):
    """Passes each value that a statement throws away, or that a `yield` gives, to the helper."""

    def __init__(self, file: str) -> None:
        self._file = file

    def visit_Module(self, node: ast.Module) -> ast.AST:
        for part in node.body:
            if isinstance(part, ast.FunctionDef | ast.ClassDef):
                self.generic_visit(part)
        return node

    def visit_Expr(self, node: ast.Expr) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.value, ast.Call):
            node.value = self._watched(node.value)
        return node

    def visit_Yield(self, node: ast.Yield) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.value, ast.Call):
            node.value = self._watched(node.value)
        return node

    def _watched(self, call: ast.Call) -> ast.Call:
        place = f"{self._file}, line {call.lineno}"
        said = [ast.Constant(ast.unparse(call.func)), ast.Constant(place)]
        helper = ast.Call(ast.Name(_HELPER, ast.Load()), [call, *said], [])
        return ast.copy_location(helper, call)


@dataclass(frozen=True, slots=True)
class _LostMotion:
    line: int
    where: str
    """Function that calls it, as `Wave.run`."""
    motion: str


class _Check:
    """Finds calls of known motions whose generator goes nowhere."""

    def __init__(self, tree: ast.Module, module: Mapping[str, object]) -> None:
        self._tree, self._module = tree, module

    def lost(self) -> Iterator[_LostMotion]:
        """Yield the calls in the order of the text."""
        for owner, function in _functions(self._tree):
            worlds = _worlds(function)
            above = {id(child): node for node in ast.walk(function) for child in ast.iter_child_nodes(node)}
            where = f"{owner.name}.{function.name}" if owner is not None else function.name
            for call in _calls(function):
                known = self._is_motion(call.func, owner, worlds)
                if known and _goes_nowhere(call, above[id(call)], function):
                    yield _LostMotion(call.lineno, where, ast.unparse(call.func))

    def _is_motion(self, called: ast.expr, owner: ast.ClassDef | None, worlds: frozenset[str]) -> bool:
        match called:
            case ast.Name(id=name):
                return inspect.isgeneratorfunction(self._module.get(name))
            case ast.Attribute(value=ast.Name(id="self"), attr=name) if owner is not None:
                return inspect.isgeneratorfunction(getattr(self._module.get(owner.name), name, None))
            case ast.Attribute(value=ast.Attribute(value=ast.Name(id=world), attr=part), attr=name):
                return world in worlds and name in _world_motions().get(part, ())
            case _:
                return False


def _functions(tree: ast.Module) -> Iterator[tuple[ast.ClassDef | None, ast.FunctionDef]]:
    """Yield the functions of a module, and the methods of its classes with their class."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield None, node
        elif isinstance(node, ast.ClassDef):
            yield from ((node, one) for one in node.body if isinstance(one, ast.FunctionDef))


def _calls(function: ast.FunctionDef) -> list[ast.Call]:
    """Return the calls in a function in the order of the text."""
    found = (node for node in ast.walk(function) if isinstance(node, ast.Call))
    return sorted(found, key=lambda node: (node.lineno, node.col_offset))


def _worlds(function: ast.FunctionDef) -> frozenset[str]:
    """Return the parameters that are the `World`: by their annotation, or else by their name."""
    arguments = (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)
    return frozenset(
        one.arg
        for one in arguments
        if (
            ast.unparse(one.annotation).strip("'\"").endswith("World")
            if one.annotation
            else one.arg == "world"
        )
    )


def _goes_nowhere(call: ast.Call, parent: ast.AST, function: ast.FunctionDef) -> bool:
    """Whether the generator is thrown away, or used as if it were the motion's result."""
    match parent:
        case ast.Expr() | ast.Yield():
            return True
        case ast.If(test=test) | ast.While(test=test) | ast.IfExp(test=test) | ast.Assert(test=test):
            return test is call
        case ast.UnaryOp(op=ast.Not()) | ast.Compare() | ast.Subscript():
            return True
        case ast.Attribute(attr=name):
            return not hasattr(GeneratorType, name)
        case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)):
            return not any(
                isinstance(node, ast.Name) and node.id == name and isinstance(node.ctx, ast.Load)
                for node in ast.walk(function)
            )
        case _:
            return False


@cache
def _world_motions() -> Mapping[str, frozenset[str]]:
    """Return the motions of the parts of `World` by the part's name.

    They are read from the sources: a check of a mission does not import the robot's control.
    """
    source = _Source(_WORLD)
    fields = (node for node in source.classes["World"].body if isinstance(node, ast.AnnAssign))
    return {ast.unparse(node.target): source.motions(ast.unparse(node.annotation)) for node in fields}


class _Source:
    """Classes of one of our files, and the files from which it imports others."""

    def __init__(self, path: Path) -> None:
        tree = ast.parse(path.read_bytes())
        self.classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
        self._files = {
            alias.name: path.parents[node.level - 1]
            .joinpath(*(node.module or "").split("."))
            .with_suffix(".py")
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.level
            for alias in node.names
        }

    def motions(self, kind: str) -> frozenset[str]:
        """Return the names of the methods of a class and its bases that return a generator."""
        if kind not in self.classes:
            file = self._files.get(kind)
            return _Source(file).motions(kind) if file is not None and file.is_file() else frozenset()
        own = self.classes[kind]
        bases = (self.motions(ast.unparse(base)) for base in own.bases)
        methods = (one for one in own.body if isinstance(one, ast.FunctionDef) and not one.decorator_list)
        return frozenset(one.name for one in methods if _returns_generator(one)).union(*bases)


def _returns_generator(function: ast.FunctionDef) -> bool:
    returned = function.returns
    return returned is not None and ast.unparse(returned).partition("[")[0] in _GENERATORS
