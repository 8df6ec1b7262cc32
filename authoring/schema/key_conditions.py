"""What keys of one mapping have to do with one another, as a schema: one of several, some with a value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .schema_parts import Schema

_GIVEN: Schema = {"not": {"type": "null"}}


def exactly_one(keys: Sequence[str]) -> list[Schema]:
    """One of the keys is given, and of several the later ones are too much."""
    named = ", ".join(keys)
    too_much: Schema = {"type": "null", "errorMessage": f"only one of {named} may be given"}
    found = [one_needed(keys, f"one of {named} is missing")]
    for n, key in enumerate(keys[:-1]):
        given: Schema = {"required": [key], "properties": {key: _GIVEN}}
        found.append({"if": given, "then": {"properties": dict.fromkeys(keys[n + 1 :], too_much)}})
    return found


def one_needed(keys: Sequence[str], sentence: str) -> Schema:
    """At least one of the keys is given, or that sentence is true."""
    none: Schema = {"not": {"anyOf": [{"required": [key]} for key in keys]}}
    return {"if": none, "then": {"required": [keys[0]], "errorMessage": sentence}}


def belonging(keys: Sequence[str], owner: str, other: str) -> list[Schema]:
    """The keys belong to `owner` and may not stand beside `other`."""
    given: Schema = {"required": [other], "properties": {other: _GIVEN}}
    wrong: Schema = {key: {"type": "null", "errorMessage": f"'{key}' belongs to '{owner}'"} for key in keys}
    return [{"if": given, "then": {"properties": wrong}}]


def by_value(key: str, needs: Mapping[str, Sequence[str]], may: Mapping[str, Sequence[str]]) -> list[Schema]:
    """With each value of `key` some keys are needed, and of those that any value may have others are not."""
    special = dict.fromkeys(name for names in may.values() for name in names)
    found: list[Schema] = []
    for value, names in may.items():
        then: Schema = {
            "properties": {
                name: {"type": "null", "errorMessage": f"'{value}' takes no '{name}'"}
                for name in special
                if name not in names
            }
        }
        if needs[value]:
            then |= {"required": list(needs[value])}
        found.append({"if": {"properties": {key: {"const": value}}, "required": [key]}, "then": then})
    return found
