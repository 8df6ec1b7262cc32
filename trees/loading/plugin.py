"""Loading of plug-ins: a Python file next to the mission, or an installed module, that offers nodes. Its
source is checked for motions without `yield from`, which do nothing.
"""

from __future__ import annotations

import ast
import builtins
import hashlib
import importlib
import importlib.util
import inspect
import os
import re
import sys
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import CodeType, GeneratorType, ModuleType
from typing import Final, TypeGuard, cast, get_args

from picktree.files import file_system
from picktree.trees import FILE_MODULE, Kind, Node, NodeDeclaration, Plugin, Resource, control_flow
from picktree.world import OUR_PREFIXES, Cause, Family, known_causes, restore_causes

from .plugin_import import PluginError, importing

_GENERATORS = ("Doing", "Steps", "Generator", "Iterator")
"""Return types of functions that do nothing before they are iterated."""
_HELPER: Final = "__picktree_carried_out__"
_PACKAGE = Path(__file__).resolve().parents[2]
_WORLD = _PACKAGE / "robot" / "world.py"


class UnstartedMotion(TypeError):
    """A generator that was thrown away before it was started."""


def check_motion_calls(source: bytes, module: Mapping[str, object], plugin: str) -> None:
    """Check a plug-in's source. Raises PluginError for a certain motion call without `yield from`.

    `module`: names of the executed module. Calls that are uncertain before a run are left to `compiled`.
    """
    found = list(_Check(ast.parse(source), module).lost_motions())
    if not found:
        return
    first, *others = found
    message = (
        f"the plug-in {plugin!r}, line {first.line}: {first.where} calls {first.motion} without "
        "'yield from', so that it does nothing"
    )
    further = list(dict.fromkeys(other.line for other in others if other.line != first.line))
    if further:
        message += f"; line{'s' if len(further) > 1 else ''} {', '.join(map(str, further))}, too"
    raise PluginError(message, f"write 'yield from {first.motion}(…)'", code="P261")


def compiled(source: bytes, path: Path) -> CodeType:
    """Compile a plug-in's file so that a motion which is thrown away raises UnstartedMotion at its line."""
    tree = _Watch(path.name).visit(compile(source, str(path), "exec", ast.PyCF_ONLY_AST))
    return compile(ast.fix_missing_locations(tree), str(path), "exec")


def _carried_out(value: object, motion: str, place: str) -> object:
    generator = cast("GeneratorType[object, object, object]", value)
    if type(generator) is GeneratorType and inspect.getgeneratorstate(generator) == inspect.GEN_CREATED:
        raise UnstartedMotion(f"{motion} is called without 'yield from', so that it does nothing ({place})")
    return value


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
        arguments = [ast.Constant(ast.unparse(call.func)), ast.Constant(place)]
        helper = ast.Call(ast.Name(_HELPER, ast.Load()), [call, *arguments], [])
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

    def lost_motions(self) -> Iterator[_LostMotion]:
        """Yield the calls in the order of the text."""
        for owner, function in _functions(self._tree):
            worlds = _worlds(function)
            uses = _Uses(function, partial(self._value_of, owner))
            where = f"{owner.name}.{function.name}" if owner is not None else function.name
            for call in _calls(function):
                if self._is_motion(call.func, owner, worlds) and uses.goes_nowhere(call):
                    yield _LostMotion(call.lineno, where, ast.unparse(call.func))

    def _is_motion(self, called: ast.expr, owner: ast.ClassDef | None, worlds: frozenset[str]) -> bool:
        match called:
            case ast.Attribute(value=ast.Attribute(value=ast.Name(id=world), attr=part), attr=name):
                return world in worlds and name in _world_motions().get(part, ())
            case _:
                return inspect.isgeneratorfunction(self._value_of(owner, called))

    def _value_of(self, owner: ast.ClassDef | None, named: ast.expr) -> object:
        """Return the value of a name, or of an attribute of `self`, in the module; None when it is
        unknown."""
        match named:
            case ast.Name(id=name):
                return self._module.get(name, getattr(builtins, name, None))
            case ast.Attribute(value=ast.Name(id="self"), attr=name) if owner is not None:
                return getattr(self._module.get(owner.name), name, None)
            case _:
                return None


class _Uses:
    """Uses of the values in one function."""

    def __init__(self, function: ast.FunctionDef, known: Callable[[ast.expr], object]) -> None:
        """`known` returns the value of a called expression, or None."""
        self._function, self._value_of = function, known
        self._above = {id(child): node for node in ast.walk(function) for child in ast.iter_child_nodes(node)}

    def goes_nowhere(self, motion: ast.expr) -> bool:
        """Return whether the generator is thrown away, or used as if it were the motion's result."""
        match self._above[id(motion)]:
            case ast.Expr() | ast.Yield() | ast.Compare() | ast.BinOp() | ast.FormattedValue():
                return True
            case ast.UnaryOp() | ast.Subscript():
                return True
            case ast.If(test=test) | ast.While(test=test) | ast.Assert(test=test):
                return test is motion
            case ast.IfExp() as choice:
                return choice.test is motion or self.goes_nowhere(choice)
            case ast.BoolOp() as either:
                return self.goes_nowhere(either)
            case ast.Attribute(attr=name):
                return not hasattr(GeneratorType, name)
            case ast.Return() as end:
                return self._returned_for_nothing(end)
            case ast.Call() | ast.keyword() as use:
                return self._is_misplaced_argument(motion, use)
            case ast.NamedExpr(target=ast.Name(id=name)) as named:
                return self._name_goes_nowhere(name) and self.goes_nowhere(named)
            case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)):
                return self._name_goes_nowhere(name)
            case ast.Assign(targets=[ast.Tuple() | ast.List()]):
                return True
            case _:
                return False

    def _name_goes_nowhere(self, name: str) -> bool:
        """Return whether no use of the name can start the generator that it was set to.

        A name that is set once needs only one use that a generator cannot have.
        """
        nodes = [node for node in ast.walk(self._function) if isinstance(node, ast.Name) and node.id == name]
        loads = [node for node in nodes if isinstance(node.ctx, ast.Load)]
        once = sum(isinstance(node.ctx, ast.Store) for node in nodes) == 1
        if once and any(self._needs_result(node) for node in loads):
            return True
        return all(self.goes_nowhere(node) for node in loads if not self._is_compared_with_none(node))

    def _needs_result(self, name: ast.Name) -> bool:
        match self._above[id(name)]:
            case ast.Attribute(attr=attribute):
                return not hasattr(GeneratorType, attribute)
            case ast.Subscript(value=value):
                return value is name
            case _:
                return False

    def _is_compared_with_none(self, name: ast.Name) -> bool:
        """Return whether the name is only compared with None, which starts nothing."""
        match self._above[id(name)]:
            case ast.Compare(ops=[ast.Is() | ast.IsNot()]):
                return True
            case _:
                return False

    def _returned_for_nothing(self, end: ast.Return) -> bool:
        """Return whether the function that returns a generator promises something else."""
        inside: ast.AST = end
        while not isinstance(inside, ast.FunctionDef | ast.Lambda):
            inside = self._above[id(inside)]
        if inside is not self._function:
            return False
        promised = self._function.returns
        if _yields(self._function):
            return promised is None or not any(word in ast.unparse(promised)[1:] for word in _WITHIN)
        return promised is not None and self._excludes_generators(promised, self._value_of)

    def _is_misplaced_argument(self, motion: ast.expr, use: ast.Call | ast.keyword) -> bool:
        """Return whether the parameter that gets the generator is declared as something else."""
        call = self._above[id(use)] if isinstance(use, ast.keyword) else use
        if not isinstance(call, ast.Call) or call.func is motion:
            return False
        called = self._value_of(call.func)
        if any(called is reader for reader in _RESULT_READERS):
            return True
        if not callable(called) or (isinstance(use, ast.keyword) and use.arg is None):
            return False
        if any(isinstance(one, ast.Starred) for one in call.args):
            return False
        try:
            parameters = inspect.signature(called).parameters
        except (TypeError, ValueError):
            return False
        own = [one for name, one in parameters.items() if name != "self"]
        places = [one for one in own if one.kind in (one.POSITIONAL_ONLY, one.POSITIONAL_OR_KEYWORD)]
        if isinstance(use, ast.keyword):
            one = parameters.get(use.arg or "")
        else:
            at = next(k for k, given in enumerate(call.args) if given is motion)
            one = places[at] if at < len(places) else None
        if one is None or one.annotation is one.empty:
            return False
        names = getattr(inspect.unwrap(called), "__globals__", None) or vars(
            sys.modules.get(getattr(called, "__module__", ""), builtins)
        )
        text = one.annotation if isinstance(one.annotation, str) else getattr(one.annotation, "__name__", "")
        try:
            declared = ast.parse(text, mode="eval").body
        except SyntaxError:
            return False
        return self._excludes_generators(declared, partial(_named_in, names))

    @staticmethod
    def _excludes_generators(annotation: ast.expr, known: Callable[[ast.expr], object]) -> bool:
        """Return whether every type of an annotation is a known class that no generator belongs to."""
        match annotation:
            case ast.Constant(value=None):
                return True
            case ast.BinOp(left=left, right=right):
                return _Uses._excludes_generators(left, known) and _Uses._excludes_generators(right, known)
            case ast.Name():
                kind = known(annotation)
            case _:
                return False
        try:
            return isinstance(kind, type) and not issubclass(GeneratorType, kind)
        except TypeError:
            return False


_WITHIN: Final = tuple(f"[{word}" for word in _GENERATORS) + tuple(f", {word}" for word in _GENERATORS)
_RESULT_READERS: Final = (bool, str, repr, len, float, int, abs, round, format)
"""Built-in functions that read a value and start no generator."""


def _named_in(names: Mapping[str, object], named: ast.expr) -> object:
    return names.get(named.id, getattr(builtins, named.id, None)) if isinstance(named, ast.Name) else None


def _yields(function: ast.FunctionDef) -> bool:
    """Return whether the function itself, without those defined in it, is a generator."""
    todo: list[ast.AST] = list(function.body)
    while todo:
        node = todo.pop()
        if isinstance(node, ast.Yield | ast.YieldFrom):
            return True
        if not isinstance(node, ast.FunctionDef | ast.Lambda | ast.ClassDef):
            todo += ast.iter_child_nodes(node)
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


@cache
def _world_motions() -> Mapping[str, frozenset[str]]:
    """Return the motions of the parts of `World` by the part's name.

    They are read from the sources: a check of a mission does not import the robot's control.
    """
    source = _Source(_WORLD)
    fields = (node for node in source.classes["World"].body if isinstance(node, ast.AnnAssign))
    return {ast.unparse(node.target): source.motions(ast.unparse(node.annotation)) for node in fields}


def _imported_file(path: Path, node: ast.ImportFrom) -> Path:
    """Return the module from which a file imports, or the stub of the door."""
    names = (node.module or "").split(".")
    if node.level:
        return path.parents[node.level - 1].joinpath(*names).with_suffix(".py")
    return file_system.ROOT.joinpath(*names[1:], "__init__.pyi")


class _Source:
    """Classes of one of our files, and the files from which it imports others."""

    def __init__(self, path: Path) -> None:
        tree = ast.parse(path.read_bytes())
        self.classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
        self._files = {
            alias.name: _imported_file(path, node)
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom)
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


def offered_nodes(module: ModuleType, plugin: str, attribute: str) -> tuple[type[Node], ...]:
    """Return the node classes that a plug-in's module lists. Raises PluginError for an invalid class."""
    nodes: object = getattr(module, attribute, None)
    if not isinstance(nodes, tuple | list):
        what = "has no" if nodes is None else "has something else as"
        own = dict.fromkeys(v.__name__ for v in vars(module).values() if _is_node(v, module))
        hint = f"write '{attribute} = ({', '.join(own)},)'" if own else f"as '{attribute} = (Wave,)'"
        raise PluginError(
            f"the plug-in {plugin!r} {what} {attribute}, a tuple of node classes", hint, code="P253"
        )
    if not nodes:
        raise PluginError(f"the plug-in {plugin!r} offers no node: its {attribute} is empty", code="P253")
    for node in cast("tuple[object, ...]", nodes):
        if not _is_node(node):
            raise PluginError(
                f"the plug-in {plugin!r}: {_described_type(node)} in {attribute} is not a node class",
                "a class derived from Skill, ConditionNode or Control",
                code="P253",
            )
        _check(node, plugin)
    return cast("tuple[type[Node], ...]", tuple(cast("tuple[object, ...]", nodes)))


def _is_node(value: object, module: ModuleType | None = None) -> TypeGuard[type[Node]]:
    """Whether the value is a node class, and one that this module itself defines."""
    if not (isinstance(value, type) and issubclass(value, Node)):
        return False
    own = module is None or value.__module__ == module.__name__
    return own and isinstance(vars(value).get("declaration"), NodeDeclaration)


def _described_type(value: object) -> str:
    name = value.__name__ if isinstance(value, type) else type(value).__name__
    article = "an" if name[0] in "aeiouAEIOU" else "a"
    return name if isinstance(value, type) else f"{article} {name}"


def _check(node: type[Node], plugin: str) -> None:
    """Check a node class for errors that would otherwise appear at the build or at its first failure."""
    declaration = node.declaration

    def wrong(message: str, hint: str = "") -> PluginError:
        return PluginError(f"the plug-in {plugin!r}: node {declaration.id}: {message}", hint, code="P254")

    unwritten = sorted(getattr(node, "__abstractmethods__", ()))
    if unwritten:
        raise wrong(f"it has no {unwritten[0]!r}", "as 'def run(self, world): ...', with a 'yield' in it")
    if node.on_tick is Node.on_tick:
        raise wrong("it has no 'on_tick'", "derive it from Skill and write 'run', or write 'on_tick'")
    if declaration.kind not in get_args(Kind):
        raise wrong(f"its kind {declaration.kind!r} is unknown", _one_of(Kind))
    if declaration.hand_after not in get_args(control_flow.Hand):
        raise wrong(f"its hand_after {declaration.hand_after!r} is unknown", _one_of(control_flow.Hand))
    if not _are(declaration.uses, Resource):
        raise wrong("'uses' is a tuple of resources", "as 'uses = (ARM, GRIPPER)'")
    if not _are(declaration.causes, Cause, Family):
        raise wrong("'causes' is a tuple of causes", "as 'causes = (grasp.MISSED, planning.ANY)'")
    if node.__init__ is not Node.__init__:
        hint = "leave it out; what a node begins with is set in 'on_start'"
        raise wrong("it has an '__init__' of its own", hint)
    for cause in declaration.causes:
        _check_cause(cause, plugin, declaration.id)


def _one_of(words: object) -> str:
    return f"one of {', '.join(get_args(words))}"


def _are(values: object, *kinds: type) -> bool:
    return isinstance(values, tuple) and all(isinstance(v, kinds) for v in cast("Iterable[object]", values))


def _check_cause(cause: Cause | Family, plugin: str, node: str) -> None:
    known = known_causes()
    where = f"the plug-in {plugin!r}: node {node}"
    if isinstance(cause, Family):
        if not any(name.startswith(f"{cause.name}.") for name in known):
            raise PluginError(f"{where}: no cause of the family '{cause}' is registered", code="P255")
    elif cause.name not in known:
        prefix = cause.name.split(".")[0]
        hint = "write 'register_cause(Cause(...))'"
        if prefix in OUR_PREFIXES:
            hint = f"the prefix {prefix!r} belongs to picktree; register the cause under a prefix of your own"
        raise PluginError(f"{where}: the cause '{cause}' is not registered", hint, code="P255")
    elif known[cause.name] != cause:
        meaning = known[cause.name].sentence
        message = f"{where}: the cause '{cause}' is registered with another meaning ({meaning!r})"
        raise PluginError(message, "use what 'register_cause' returns", code="P255")


_DOTTED = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")
_PACKAGE_PREFIX = "picktree."
_RUN_ATTRIBUTE = "__picktree_run__"
"""Attribute under which a file's module keeps its `_Run`."""
PLUGINS_VARIABLE = "PICKTREE_PLUGINS"
"""Environment variable that is `refuse` where plug-ins of missions may not be run."""


def load_plugin(plugin: str, folder: Path) -> Plugin:
    """Load a Python file in `folder` (`wave.py`), or a module by its name. Raises PluginError.

    With `PICKTREE_PLUGINS=refuse` in the environment it runs none, and raises.
    """
    if os.environ.get(PLUGINS_VARIABLE) == "refuse":
        message = f"the plug-in {plugin!r} is not run, because nobody has said that this folder is trusted"
        raise PluginError(message, "a plug-in is a program: read it, then trust the folder", code="P262")
    return _file(plugin, folder) if plugin.endswith(".py") else _named(plugin, folder)


def load_installed(module: str, distribution: str = "") -> Plugin:
    """Load the target of an entry point: a module, or `module:attribute`. Raises PluginError."""
    name, _, attribute = module.partition(":")
    with importing(name):
        found = importlib.import_module(name)
        nodes = offered_nodes(found, name, attribute or "NODES")
        for other in dict.fromkeys(node.__module__ for node in nodes):
            if not other.startswith(_PACKAGE_PREFIX):
                own = sys.modules[other]
                check_motion_calls(_source(own)[1], vars(own), other)
    return Plugin(name, nodes, *_source(found), distribution)


def _named(name: str, folder: Path) -> Plugin:
    if not _DOTTED.fullmatch(name):
        hint = "as 'my_cell.skills', or 'wave.py' for a file beside the mission"
        raise PluginError(f"{name!r} cannot be the name of a module", hint, code="P257")
    beside = f"{name}.py"
    hint = f"for the file beside the mission write {beside!r}" if file_system.is_file(folder / beside) else ""
    try:
        return load_installed(name)
    except PluginError as error:
        cause = error.__cause__
        if isinstance(cause, ModuleNotFoundError) and _is_part(cause.name, name):
            message = f"there is no plug-in {name!r}: no module of that name is installed"
            raise PluginError(message, hint, code="P257") from None
        if error.code == "P253" and hint:  # a module of Python's own may have the same name
            raise PluginError(error.message, hint, code="P253") from None
        raise


def _is_part(missing: str | None, name: str) -> bool:
    """Whether the missing module is the requested one or a package that contains it."""
    return missing is not None and (name == missing or name.startswith(f"{missing}."))


def _file(plugin: str, folder: Path) -> Plugin:
    try:
        path = (folder / plugin).resolve()
        outside = not path.is_relative_to(folder.resolve())
    except (OSError, ValueError):
        raise PluginError(f"{plugin!r} cannot be the name of a file", code="P257") from None
    if outside:
        message = f"the plug-in {plugin!r} lies outside of the mission's folder"
        raise PluginError(message, "copy it there, or install it and name its module", code="P251")
    if not file_system.is_file(path):
        raise PluginError(f"there is no plug-in {plugin!r} beside the mission", code="P257")
    with importing(plugin):
        source = path.read_bytes()
        name = f"{FILE_MODULE}{path.stem}_{hashlib.sha256(bytes(path)).hexdigest()[:8]}"
        with _replaced(name) as before:
            module = _run(name, path, source, before)
            nodes = offered_nodes(module, plugin, "NODES")
            check_motion_calls(source, vars(module), plugin)
    return Plugin(plugin, nodes, path, source)


@dataclass(frozen=True, slots=True)
class _Run:
    """Record of an executed plug-in file. An unchanged text is not run again; an edited one replaces it and
    its causes."""

    digest: str
    causes: frozenset[str]


@contextmanager
def _replaced(name: str) -> Generator[ModuleType | None]:
    """Yield the module that now has the name; restore it when the block fails."""
    before = sys.modules.get(name)
    try:
        yield before
    except BaseException:
        sys.modules.pop(name, None)
        if before is not None:
            sys.modules[name] = before
        raise


def _run(name: str, path: Path, source: bytes, before: ModuleType | None) -> ModuleType:
    """Return the file's module. Missions that name the same file share its classes, as with an import."""
    digest = hashlib.sha256(source).hexdigest()
    last: _Run | None = getattr(before, _RUN_ATTRIBUTE, None)
    if before is not None and last is not None:
        if last.digest == digest:
            return before
        restore_causes({n: cause for n, cause in known_causes().items() if n not in last.causes})
    kept = known_causes()
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    vars(module)[_HELPER] = _carried_out
    exec(compiled(source, path), vars(module))
    setattr(module, _RUN_ATTRIBUTE, _Run(digest, frozenset(known_causes()) - frozenset(kept)))
    return module


def _source(module: ModuleType) -> tuple[Path | None, bytes]:
    file = getattr(module, "__file__", None)
    if not isinstance(file, str) or not file.endswith(".py"):
        return None, b""
    path = Path(file)
    try:
        return path, path.read_bytes()
    except OSError:
        return None, b""
