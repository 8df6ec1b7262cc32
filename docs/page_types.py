"""Types of the records that the studio's page receives as they are, in TypeScript.

python docs/page_types.py > apps/studio/page/src/records.ts
"""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from picktree.apps.batch.cost_forecast import BatchForecast, VariantForecast
from picktree.apps.studio.workspace import ListedFile, TextFile
from picktree.authoring.schema.node_reference import PortEntry, SlotEntry
from picktree.logs.run_index import RunRow

RECORDS = (ListedFile, TextFile, RunRow, VariantForecast, BatchForecast, PortEntry, SlotEntry)
_PLAIN = {str: "string", bool: "boolean", int: "number", float: "number", type(None): "null"}


def typescript(hint: Any) -> str:
    """Return the type of a value in JSON. Raises TypeError for one that JSON does not have."""
    if hint in _PLAIN or hint in RECORDS:
        return _PLAIN.get(hint) or hint.__name__
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Literal:
        return " | ".join(f'"{value}"' for value in parts)
    if origin in (Union, types.UnionType):
        return " | ".join(map(typescript, parts))
    if origin is tuple and parts[1:] == (...,):
        inner = typescript(parts[0])
        return f"({inner})[]" if "|" in inner else f"{inner}[]"
    if origin is Mapping:
        return f"Record<{typescript(parts[0])}, {typescript(parts[1])}>"
    raise TypeError(f"no type of TypeScript for {hint}")


def interface(record: type[Any]) -> str:
    hints = get_type_hints(record)
    rows = [f"  {each.name}: {typescript(hints[each.name])};" for each in fields(record)]
    summary = (record.__doc__ or "").partition("\n")[0]
    return "\n".join([f"// {summary}", f"export interface {record.__name__} {{", *rows, "}"])


if __name__ == "__main__":
    print("// Records of the server, made by docs/page_types.py from their declarations in Python.\n")
    print("\n\n".join(map(interface, RECORDS)))
