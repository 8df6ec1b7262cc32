"""JSON Schema of the files that pydantic models read: scenes, robots, faults, cases."""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Iterator
from itertools import pairwise
from typing import cast, get_args

from pydantic import TypeAdapter

from picktree.files import quantities
from picktree.files.yaml import file_models

from .schema_parts import DRAFT, Schema, exactly_one, header, model_name, schema, schemas, tidy, unless_null


def attribute_docs(cls: type) -> dict[str, str]:
    """Return the docstrings of attributes by name, with those of bases; empty without source code."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if base.__module__.partition(".")[0] == cls.__module__.partition(".")[0]:
            found |= _own(base)
    return found


def _own(cls: type) -> dict[str, str]:
    try:
        source = textwrap.dedent(inspect.getsource(cls))
    except (OSError, TypeError):
        return {}
    (body,) = (node.body for node in ast.parse(source).body if isinstance(node, ast.ClassDef))
    found: dict[str, str] = {}
    for field, below in pairwise(body):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            text = below.value if isinstance(below, ast.Expr) else None
            if isinstance(text, ast.Constant) and isinstance(text.value, str):
                found[field.target.id] = " ".join(text.value.split())
    return found


_BOUNDS = (("exclusiveMinimum", "more than"), ("minimum", "at least"), ("maximum", "at most"))


def model_schema(kind: str, root: type[file_models.AnyModel]) -> Schema:
    """Return the schema of a kind of file whose content, without the header, is that model."""
    raw = schema(TypeAdapter(root).json_schema())
    models = {model.__name__: model for model in _models(root)}
    found = _documented(raw, root)
    found["title"] = f"picktree {kind}"
    found["properties"] = header(kind) | schema(found["properties"])
    found["required"] = ["picktree", "kind", *cast("list[str]", found.get("required", []))]
    found["definitions"] = {
        model_name(name): _documented(schema(part), models[name])
        for name, part in schema(raw.get("$defs")).items()
    }
    return {"$schema": DRAFT} | found


def _models(root: type[file_models.AnyModel]) -> Iterator[type[file_models.AnyModel]]:
    """Yield the root and all models that its fields use."""
    waiting, seen = [root], set[type[file_models.AnyModel]]()
    while waiting:
        model = waiting.pop()
        if model not in seen:
            seen.add(model)
            yield model
            for field in file_models.model_fields(model).values():
                waiting += _inside(file_models.declared_type(field))


def _inside(part: object) -> Iterator[type[file_models.AnyModel]]:
    """Yield the models in an annotation, or in the input type of a validator."""
    part = part.form if isinstance(part, file_models.ReadAs) else part
    part = getattr(part, "json_schema_input_type", part)
    if isinstance(part, type):
        if file_models.is_model(part):
            yield part
        return
    metadata: tuple[object, ...] = getattr(part, "__metadata__", ())
    for below in (*get_args(part), *metadata):
        yield from _inside(below)


def _documented(raw: Schema, model: type[file_models.AnyModel]) -> Schema:
    """Return the schema of one model, with the documentation of its keys."""
    docs = attribute_docs(model)
    fields = file_models.model_fields(model)
    names = {field.alias or name: name for name, field in fields.items()}
    required = cast("list[str]", raw.get("required", []))
    found = tidy({key: value for key, value in raw.items() if key not in ("properties", "$defs")})
    found["title"] = model_name(model.__name__)
    found["properties"] = {
        key: _key(
            schema(part),
            fields[names[key]].description or docs.get(names[key], ""),
            required=key in required,
        )
        for key, part in schema(raw.get("properties")).items()
    }
    keys: tuple[str, ...] = getattr(model, "one_of", ())
    if keys:
        found["allOf"] = exactly_one(keys)
    return found


def _key(raw: Schema, doc: str, *, required: bool) -> Schema:
    found = tidy(raw)
    if "$ref" in found:
        found = {"allOf": [{"$ref": found["$ref"]}]}  # beside a $ref nothing else counts
    default = raw.get("default")
    if default is not None and not isinstance(default, dict):
        # Separate from the type: language servers would insert it wherever the mapping around it is started.
        parts = [*schemas(found.get("allOf")), {"default": default}]
        found |= {"allOf": parts}
    facts = [_bounds(raw), _unit(raw), "required" if required else _default(raw)]
    line = "; ".join(filter(None, facts))
    docs: Schema = {"description": doc, "markdownDescription": f"{doc}\n\n*{line}*" if line else doc}
    return found | docs


def _number(raw: Schema) -> Schema:
    """Return the number schema of a value, or of a list of equal numbers."""
    one = unless_null(raw)
    parts = [*schemas(one.get("prefixItems")), *([schema(one["items"])] if "items" in one else [])]
    return parts[0] if parts and all(part == parts[0] for part in parts) else one


def _unit(raw: Schema) -> str:
    unit = str(_number(raw).get("unit", ""))
    return f'a bare number is in {unit}; or with a unit, as "{quantities.example(unit)}"' if unit else ""


def _bounds(raw: Schema) -> str:
    number = _number(raw)
    unit = str(number.get("unit", ""))
    return ", ".join(f"{words} {_shown(number[key], unit)}" for key, words in _BOUNDS if key in number)


def _default(raw: Schema) -> str:
    default = cast("object", raw.get("default"))
    if default in (None, "", []) or isinstance(default, dict):
        return ""
    return f"default: {_shown(default, str(_number(raw).get('unit', '')))}"


def _shown(value: object, unit: str) -> str:
    """Return a value with its unit as a file may write it; angles in degrees."""
    match value:
        case bool():
            return str(value).lower()
        case int() | float() if unit == "rad" and abs(value) > 0.01:
            return f"{math.degrees(value):g} deg"
        case int() | float():
            return f"{value:g} {unit}".rstrip()
        case list():
            return f"[{', '.join(_shown(part, unit) for part in cast('list[object]', value))}]"
        case _:
            return str(value)
