"""The IDs that may stand where a node is wanted: nodes of the registry, and sub-trees, known or not."""

from __future__ import annotations

from dataclasses import dataclass

from .schema_parts import ID_PATTERN, Schema, escaped, if_bare, ref

_END = r"(?![\s\S])"
_WORD = "[A-Za-z0-9_]*"


@dataclass(frozen=True, slots=True)
class Ids:
    """`closed`: there are no other sub-trees and nodes than these; else a plain ID may be one."""

    nodes: tuple[str, ...]
    trees: tuple[str, ...] = ()
    needing: tuple[str, ...] = ()
    """Those that need a port or a child, so that the bare ID is not enough."""
    closed: bool = False

    def properties(self) -> dict[str, Schema]:
        """What stands under each ID."""
        found = {name: ref(f"node.{name}") for name in self.nodes}
        return found | {name: ref(f"tree.{name}") for name in self.trees}

    def single(self) -> Schema:
        """One node: a mapping with its ID as the one key, or the bare ID."""
        found: Schema = {
            "title": "node",
            "type": ["object", "string"],
            "properties": self.properties(),
            # Beside the properties, a count would keep the server from proposing any in an empty line.
            "allOf": [if_bare(), {"minProperties": 1, "maxProperties": 1}],
        }
        return found | self.others()

    def others(self) -> Schema:
        """Of a mapping that holds a node: what other keys it may have."""
        if self.closed:
            return {"additionalProperties": False}
        names = {"pattern": ID_PATTERN, "patternErrorMessage": "this is no ID of a node or a sub-tree"}
        return {"propertyNames": names, "additionalProperties": ref("unknown")}

    def bare(self) -> Schema:
        """Of a text: which IDs may stand alone."""
        if self.closed:
            alone = [name for name in (*self.nodes, *self.trees) if name not in self.needing]
            pattern = f"^(?:{'|'.join(map(escaped, alone))}){_END}"
        elif self.needing:
            pattern = f"^(?!(?:{'|'.join(map(escaped, self.needing))}){_END})[A-Za-z_]{_WORD}{_END}"
        else:
            pattern = ID_PATTERN
        said = "no node of this name can stand without ports or children"
        return {"pattern": pattern, "patternErrorMessage": said}

    def only_child(self, owner: str, keys: list[str]) -> Schema:
        """Of a mapping without `do`, but with a key that is none of the owner's `keys`: that is the child.

        An unknown one in lower case may be a sub-tree, unless another key names the child.
        """
        said = f"{owner} has no such port, and there is no such node"
        own = "|".join(map(escaped, keys))
        ids = (*self.nodes, *self.trees)
        if self.closed:
            known = "|".join(map(escaped, (*keys, *ids)))
            return {"propertyNames": {"pattern": f"^(?:{known}){_END}", "patternErrorMessage": said}}
        child = "|".join((f"[A-Z]{_WORD}", *(escaped(name) for name in ids if not "A" <= name[0] <= "Z")))
        not_own = f"(?!(?:{own}){_END})"
        return {
            "if": {"propertyNames": {"not": {"pattern": f"^{not_own}(?:{child}){_END}"}}},
            "then": {
                "patternProperties": {
                    f"^{not_own}": {"type": ["object", "array", "string", "null"], "errorMessage": said}
                }
            },
            "else": {"propertyNames": {"pattern": f"^(?:{own}|{child}){_END}", "patternErrorMessage": said}},
        }
