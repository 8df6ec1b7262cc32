"""Python stub of nodes: constructors with typed ports, for editors and type checkers."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from textwrap import indent
from typing import Final

from picktree.trees import POSTCONDITIONS, PRECONDITIONS, NodeDeclaration, documented, signature_of

_HEAD: Final = """\
# Written by `picktree nodes --stub`: the constructors of the nodes, with their ports.
from collections.abc import Iterable, Mapping
from os import PathLike
from types import ModuleType
from typing import Any, Literal, TypeAlias, TypedDict, Unpack

from picktree.trees import Node
from picktree.trees import TreeDefinition as Tree

Child: TypeAlias = Node | Iterable[Node]
"""
_TAIL: Final = """
class SubTree(Node):
    \"\"\"A call of a tree that was defined in Python, or (by its name) of a tree of an included file.\"\"\"

    def __init__(self, tree: Tree, /, **ports: Any) -> None: ...

def plugin(file: str | PathLike[str]) -> ModuleType:
    \"\"\"Return the module of a plug-in's file, whose nodes are its attributes.\"\"\"
"""


def stub(nodes: Iterable[NodeDeclaration]) -> str:
    """Return the text of a stub module with a class for each node."""
    conditions = "".join(f"    {key}: str\n" for key in (*PRECONDITIONS, *POSTCONDITIONS, "breakpoint"))
    head = f"{_HEAD}\nclass Conditions(TypedDict, total=False):\n{conditions}"
    return "\n".join([head, *map(_class, nodes), _TAIL.lstrip()])


def _class(node: NodeDeclaration) -> str:
    doc = indent(f'"""{documented(node)}"""', "    ").replace("\n    \n", "\n\n").rstrip()
    parameters = ["self"]
    named = False
    for parameter in signature_of(node).parameters.values():
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY and not named:
            named = True
            parameters += [] if any(each.startswith("*") for each in parameters) else ["*"]
        parameters.append(_parameter(parameter))
    body = "".join(f"        {each},\n" for each in parameters)
    return f"class {node.id}(Node):\n{doc}\n\n    def __init__(\n{body}    ) -> None: ...\n"


def _parameter(parameter: inspect.Parameter) -> str:
    stars = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}
    default = "" if parameter.default is inspect.Parameter.empty else " = ..."
    return f"{stars.get(parameter.kind, '')}{parameter.name}: {parameter.annotation}{default}"
