"""Our reading of YAML against that of npm's `yaml`, which editors use: the same values at the same places."""

from __future__ import annotations

import json
import math
import random
import subprocess
from pathlib import Path
from typing import Any

from picktree.files import FileError, Mark
from picktree.files.yaml import YamlNode, read

from ..needs import packages
from .yaml_texts import PIECES, SCALARS, TEXTS

NODE = Path(__file__).parent / "node"


def invented(count: int) -> list[str]:
    draw = random.Random(12)
    return ["".join(draw.choices(PIECES, k=draw.randint(1, 14))) + "\n" for _ in range(count)]


def all_texts() -> list[str]:
    around = ["k: {}\n", "- {}\n", "k: [{}, b]\n", "{}: v\n", "k: {{a: {}}}\n"]
    return [*(form.format(scalar) for scalar in SCALARS.split() for form in around), *TEXTS, *invented(3000)]


def theirs(texts: list[str]) -> list[dict[str, Any]]:
    packages("editor").require()
    given = json.dumps(texts)
    done = subprocess.run(["node", "read_yaml.mjs"], cwd=NODE, input=given, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def differences(ours: YamlNode, other: dict[str, Any], where: str = "") -> list[str]:
    if "alias" in other:
        return []
    found: list[str] = []
    value = ours.value
    # An anchored value begins for us at its anchor, and a value that is not there begins nowhere.
    if other.get("at") and not other["anchored"] and value not in (None, ""):
        found += [f"{where}: at {ours.mark} and {other['at']}"] * (tuple(other["at"]) != place(ours.mark))
    if "map" in other:
        keys = [key for key, _, _ in other["map"]]
        if not isinstance(value, dict) or list(value) != keys:
            return [f"{where}: {value!r} and the keys {keys}"]
        for key, at, inner in other["map"]:
            found += [f"{where}: key {key} at {at}"] * (at is not None and tuple(at) != place(ours.keys[key]))
            found += differences(ours.entries[key], inner, f"{where}.{key}")
        return found
    if "list" in other:
        if not isinstance(value, list) or len(value) != len(other["list"]):
            return [f"{where}: {value!r} and a list of {len(other['list'])}"]
        pairs = zip(ours.items, other["list"], strict=True)
        return found + [d for n, pair in enumerate(pairs) for d in differences(*pair, f"{where}[{n}]")]
    same = is_number(value, other["number"]) if "number" in other else is_same(value, other["scalar"])
    return found if same else [f"{where}: {value!r} and {other}"]


def place(mark: Mark) -> tuple[int, int]:
    return mark.line, mark.column


def is_number(value: object, text: str) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    number = float(text)
    return math.isnan(value) if math.isnan(number) else float(value) == number


def is_same(value: object, other: object) -> bool:
    return type(value) is type(other) and value == other


def test_what_both_read_is_the_same() -> None:
    texts = all_texts()
    wrong: list[str] = []
    both = 0
    for text, other in zip(texts, theirs(texts), strict=True):
        try:
            reading = read(text, "f")
        except FileError:
            continue
        if reading.faults or "error" in other or "&" in text:
            continue
        both += 1
        wrong += [f"{text!r}{difference}" for difference in differences(reading.root, other["root"])]
    assert wrong == []
    assert both > 800


LENIENT = {
    "k: [-, b]\n",  # a lone '-' between brackets is a text
    "k: {a: -}\n",
    '"y"#\n',
}
"""What we read and an editor complains of."""


def test_what_editors_refuse_is_refused() -> None:
    """But for comments without a blank before them, and for keys over two lines, where libyaml is lenient."""
    texts = [text for text in all_texts() if text not in LENIENT]
    accepted: list[str] = []
    for text, other in zip(texts, theirs(texts), strict=True):
        if other.get("error") in (None, "MISSING_CHAR", "MULTILINE_IMPLICIT_KEY"):
            continue
        try:
            faults = read(text, "f").faults
        except FileError:
            continue
        if not faults:
            accepted.append(f"{text!r}: {other['error']}")
    assert accepted == []
