"""Small mistakes, as people and tools make them, in the text of a file."""

from __future__ import annotations

import random
import re
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import yaml

_TOKEN = re.compile(r'[\w.]+|[^\w\s]|"[^"\n]*"')
_NASTY = (
    "~", "null", "yes", "no", "on", "0", "-1", "1e400", "-1e-400", "10" * 200, "0x1F", "0b1", "1_000",
    "12:30:45", "2026-11-21", "nan", ".nan", ".inf", "30 mm", "-5 deg", "3 parsec", "{item}", '"{item}"',
    '"{}"', '"{a.b.c}"', '"{item.colour}"', "[]", "{}", "[[]]", "{a: b}", "*", "&a", "*a",
    "!!python/object:os.system", "<<: {a: 1}", "|", ">", "'", '"', "%", "@", "`", "\t", "é", "😀", "\u2028",
    "a" * 3000, "Main", "Sequence", "Recover", "items_left", "holding and", "1 +", "len(", "'a' * 10",
    "9 ** 9", "__class__", "()", "*.missed", "grasp.*", "home", "overhead", "red_bin", "../../etc/passwd",
    "/dev/zero", "three_bins", "true", "False", "''", '""',
)  # fmt: skip
_BYTES = (
    b"\x00",
    b"\xff",
    b"\xfe\xff",
    b"\xc3",
    b"\r",
    b"\x1b",
    b"\xef\xbb\xbf",
    b"\t",
    b"\x7f",
    b"\xed\xa0\x80",
)


def mutant(text: str, corpus: Sequence[str], rng: random.Random) -> bytes:
    """The text with one to four mistakes in it; `corpus` gives words of other files."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        text = rng.choice(_ON_TEXT)(text, corpus, rng)
    raw = text.encode("utf-8", "surrogatepass")
    if rng.random() < 0.06:
        raw = _bytes(raw, rng)
    return raw


def _bytes(raw: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(raw) + 1)
    match rng.randrange(4):
        case 0:
            return raw[:at] + rng.choice(_BYTES) + raw[at:]
        case 1:
            return raw[:at] + bytes([rng.randrange(256)]) + raw[at + 1 :]
        case 2:
            return raw[:at]
        case _:
            return raw.decode("utf-8", "replace").encode(rng.choice(("utf-16", "utf-32", "utf-8-sig")))


def _token(text: str, corpus: Sequence[str], rng: random.Random) -> str:
    tokens = list(_TOKEN.finditer(text))
    if not tokens:
        return text
    found = rng.choice(tokens)
    other = _TOKEN.findall(rng.choice(corpus)) or [""]
    new = rng.choice(
        (
            rng.choice(_NASTY),
            rng.choice(other),
            rng.choice(tokens)[0],
            "",
            found[0] * 2,
            _typo(found[0], rng),
            _typo(found[0], rng),
        )
    )
    return text[: found.start()] + new + text[found.end() :]


def _typo(word: str, rng: random.Random) -> str:
    at = rng.randrange(len(word) + 1)
    match rng.randrange(4):
        case 0:
            return word[:at] + word[at + 1 :]
        case 1:
            return word[:at] + rng.choice("abcxyzEO_-. 0129") + word[at:]
        case 2:
            return word[:at] + word[at : at + 2][::-1] + word[at + 2 :]
        case _:
            return word.swapcase()


def _line(text: str, corpus: Sequence[str], rng: random.Random) -> str:
    lines = text.split("\n")
    at = rng.randrange(len(lines))
    other = rng.randrange(len(lines))
    match rng.randrange(7):
        case 0:
            del lines[at]
        case 1:
            lines.insert(other, lines[at])
        case 2:
            lines[at], lines[other] = lines[other], lines[at]
        case 3:
            lines[at] = " " * rng.randrange(1, 4) + lines[at]
        case 4:
            lines[at] = lines[at][rng.randrange(1, 4) :]
        case 5:
            lines.insert(at, rng.choice(rng.choice(corpus).split("\n")))
        case _:
            lines[at] = lines[at].rstrip() + (lines[at + 1].lstrip() if at + 1 < len(lines) else "")
    return "\n".join(lines)


def _character(text: str, _: Sequence[str], rng: random.Random) -> str:
    at = rng.randrange(len(text) + 1)
    return (
        text[:at]
        + rng.choice(("", rng.choice("{}[]:,\"'#*&!|>-% \n\tabc0.=_/")))
        + text[at + rng.randrange(2) :]
    )


def _structure(text: str, corpus: Sequence[str], rng: random.Random) -> str:
    """A value moved, dropped, wrapped or replaced, in a text that stays well-formed YAML."""
    try:
        root = yaml.safe_load(text)
        other = yaml.safe_load(rng.choice(corpus))
    except yaml.YAMLError:
        return text
    holes = list(_holes(root))
    values = [owner[key] for owner, key in _holes(other)]
    if not holes or not values:
        return text
    owner, key = rng.choice(holes)
    match rng.randrange(6):
        case 0 if isinstance(owner, dict):
            del owner[key]
        case 1:
            owner[key] = [owner[key]]
        case 2:
            owner[key] = {"do": owner[key]}
        case 3:
            owner[key] = rng.choice(
                (None, True, 0, -3, 1e30, "", "x", [], {}, "{item}", "30 mm", [1, "a", None])
            )
        case 4 if isinstance(owner, dict) and isinstance(key, str):
            owner[_typo(key, rng)] = owner.pop(key)
        case _:
            owner[key] = rng.choice(values)
    try:
        return yaml.safe_dump(root, sort_keys=False, allow_unicode=True, width=110)
    except (yaml.YAMLError, RecursionError, ValueError):
        return text


def _holes(value: object) -> list[tuple[dict[object, object] | list[object], object]]:
    found: list[tuple[dict[object, object] | list[object], object]] = []
    entries = (
        value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    )
    for key, inner in list(entries):
        found.append((value, key))  # type: ignore[arg-type]
        found += _holes(inner)
    return found


_ON_TEXT: tuple[Callable[[str, Sequence[str], random.Random], str], ...] = (
    _token, _token, _token, _line, _line, _character, _structure, _structure, _structure,
)  # fmt: skip


def told(row: dict[str, Any]) -> str:
    """Return the line of a finished job."""
    return f"{dict(row['counts'])}, {row['worst']:.2f} s; {len(row['problems'])} problems"


def told_all(rows: Sequence[dict[str, Any]]) -> str:
    """Return the report on all jobs, with the first problems."""
    total: Counter[str] = Counter()
    for row in rows:
        total.update(row["counts"])
    problems: list[str] = [problem for row in rows for problem in row["problems"]]
    lines = [f"{sum(total.values())} files: {dict(total)}"]
    lines.append(f"slowest {max(row['worst'] for row in rows):.2f} CPU s; {len(problems)} problems")
    return "\n".join([*lines, *problems[:40]])
