"""Campaigns behind docs/figures.md, what they printed, and the page that is made of it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from _campaign import CUT_OFF, ROOT, Figure, figures
from _campaign_results import repeated
from _dependencies import content

import yaml

INTRODUCTION = """# Figures

What campaigns measured, each with the command that repeats it. `make campaign HOURS=2` runs them, those first
that have no figure, are old or uncertain, and writes this page; nothing on it is typed by hand. Rates carry N
and their 95 % interval (Wilson). CPU times are of one core of a shared machine of two. Targets are those that
the project set itself. Figures of earlier versions, and of programs that are no campaigns, are in
[measurements.md](measurements.md).
"""
TABLE = ROOT / "benchmarks" / "evidence.yaml"
KEPT = ROOT / "benchmarks" / "evidence.json"
LEAST_SHARE = 0.25
"""Count of a new result below which an old one stays on the page, as a share of the old one's."""
NAMED = 3
"""Number of changed files that the page names; the others are counted."""


@dataclass(frozen=True)
class Campaign:
    """Campaign of evidence.yaml."""

    name: str
    title: str
    words: str
    command: str
    """Program in benchmarks/ with its options, without --runs."""
    runs: int
    targets: Mapping[str, str] = field(default_factory=dict[str, str])
    """`at least X %`, `at most X %` or `interval above X %`, by the name of a rate."""
    picture: str = ""
    """File in docs/ that the program draws; empty for none."""

    @property
    def line(self) -> str:
        """Command as it is typed at the root of the checkout."""
        return f"python benchmarks/{self.command} --runs {self.runs}"

    @property
    def program(self) -> Path:
        return ROOT / "benchmarks" / self.command.split()[0]

    @property
    def folder(self) -> Path:
        """Folder of its results."""
        return ROOT / "benchmarks" / "results" / "evidence" / self.name

    def alike(self, record: Record | None) -> bool:
        """Whether some of a result's runs were repeated with the files as they are, all with the same end."""
        if record is None:
            return False
        found = repeated(self.folder, record.commit)
        return 0 < found.again == found.same and found.hold


@dataclass(frozen=True)
class Record:
    """Last result of a campaign."""

    commit: str
    date: str
    text: str
    """All that the program printed as its result."""
    files: str
    """Files that its runs depended on, each with the digest of its content: `skills/push.py:1f2e3d4c …`."""

    @property
    def changed(self) -> list[str]:
        """Files that have changed since."""
        return [file for file, _, known in map(_parted, self.files.split()) if content(file) != known]

    @property
    def cut_off(self) -> str:
        """Sentence that says after how many runs it was cut off; empty for a whole campaign."""
        first = self.text.partition("\n")[0]
        return first if first.startswith(CUT_OFF) else ""

    @property
    def n(self) -> int:
        """Sum of what its rates count."""
        return sum(rate.n for rate in self.rates.values())

    def replaces(self, kept: Record | None, *, alike: bool) -> bool:
        """Return whether the page takes it: a kept result that still holds may count more, and an old one so
        much more that it says more in spite of its age.

        alike: runs of the old one that were repeated came out the same, so that it holds for all one knows.
        """
        return kept is None or self.n >= kept.n * (LEAST_SHARE if kept.changed and not alike else 1.0)

    @property
    def rates(self) -> Mapping[str, Figure]:
        """Rates by name, in the order of the text."""
        return figures(self.text)


def with_contents(files: Iterable[str]) -> str:
    """Return files as a record has them, with what they hold now."""
    return " ".join(f"{file}:{content(file)}" for file in files)


def _parted(word: str) -> tuple[str, str, str]:
    return word.rpartition(":")


def campaigns(path: Path = TABLE) -> list[Campaign]:
    """Read the table. Raises SystemExit with the place of a fault in it."""
    try:
        found = [Campaign(**entry) for entry in yaml.safe_load(path.read_text(encoding="utf-8"))]
    except (TypeError, yaml.YAMLError) as error:
        raise SystemExit(f"{path}: {error}") from None
    for one in found:
        for name, words in one.targets.items():
            if met(words, Figure(name, 1, 1)) is None:
                raise SystemExit(
                    f"{path}: {one.name}: {words!r} is none of at least, at most, interval above X %"
                )
    return found


def met(target: str, rate: Figure) -> bool | None:
    """Return whether a rate meets a target; None when the target cannot be read."""
    words, _, number = target.removesuffix(" %").rpartition(" ")
    try:
        bound = float(number) / 100
    except ValueError:
        return None
    share, low = rate.share, rate.interval[0]
    return {
        "at least": share >= bound - 1e-9,
        "at most": share <= bound + 1e-9,
        "interval above": low >= bound - 1e-9,
    }.get(words)


def read(path: Path = KEPT) -> dict[str, Record]:
    """Read the kept results by the campaign's name; none when there is no file yet.

    Raises SystemExit for a result with other keys.
    """
    if not path.exists():
        return {}
    entries = json.loads(path.read_text(encoding="utf-8"))
    try:
        return {name: Record(**entry) for name, entry in entries.items()}
    except TypeError:
        raise SystemExit(f"{path}: each result has commit, date, text and files, and nothing else") from None


def write(records: Mapping[str, Record], path: Path = KEPT) -> None:
    """Write all results, whole."""
    text = json.dumps({name: asdict(records[name]) for name in sorted(records)}, ensure_ascii=False, indent=1)
    beside = path.with_suffix(".part")
    beside.write_text(text + "\n", encoding="utf-8")
    beside.replace(path)


def in_order(table: Sequence[Campaign], records: Mapping[str, Record]) -> list[Campaign]:
    """Return the campaigns in the order in which time is best spent on them."""

    def urgency(one: Campaign) -> tuple[Any, ...]:
        record = records.get(one.name)
        if record is None:
            return (0,)
        if record.changed:
            return (1, one.alike(record), record.date)
        return (2, -max((rate.width for rate in record.rates.values()), default=0.0))

    return sorted(table, key=urgency)


def to_page(table: Sequence[Campaign], records: Mapping[str, Record]) -> str:
    """Return docs/figures.md in Markdown."""
    lines = [INTRODUCTION, _targets([one for one in table if one.name in records], records)]
    for one in table:
        if one.name in records:
            lines.append(_section(one, records[one.name]))
        else:
            lines.append(f"## {one.title}\n\n{one.words} `{one.line}`: not measured yet.\n")
    return "\n".join(lines)


def _targets(measured: Sequence[Campaign], records: Mapping[str, Record]) -> str:
    """Return the table of all targets, with what was measured of each."""
    lines = ["## Targets\n", "| campaign | figure | measured | 95 % interval | target | |", "|" + "---|" * 6]
    for one in measured:
        record = records[one.name]
        old = ", old" + _repeats(one, record, " ({} of {} same at {})") if record.changed else ""
        for name, target in one.targets.items():
            rate = record.rates.get(name)
            cells = ["", "", target, "not measured" + old]
            if rate is not None:
                low, high = rate.interval
                measured_of = f"{rate.hits:,} of {rate.n:,}, {100 * rate.share:.1f} %"
                result = ("met" if met(target, rate) else "**missed**") + old
                cells = [measured_of, f"{100 * low:.1f} … {100 * high:.1f} %", target, result]
            lines.append(f"| [{one.title}](#{_anchor(one.title)}) | {name} | {' | '.join(cells)} |")
    return "\n".join([*lines, ""])


def _repeats(one: Campaign, record: Record, words: str) -> str:
    """Return in these words how many of a result's runs were repeated, with which commit, and came out the
    same; empty when none was."""
    found = repeated(one.folder, record.commit)
    return words.format(f"{found.same:,}", f"{found.again:,}", found.commits) if found.again else ""


def _anchor(title: str) -> str:
    """Return the anchor of a heading, as Markdown renderers make it."""
    return re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-")


def _section(one: Campaign, record: Record) -> str:
    changed = record.changed
    more = f" and {len(changed) - NAMED} more" if len(changed) > NAMED else ""
    names = ", ".join(f"`{file}`" for file in changed[:NAMED])
    repeats = _repeats(one, record, "; {} of {} runs came out the same when they were repeated at {}")
    old = f"**Old: {names}{more} changed since{repeats}.**" if changed else ""
    said = [f"{one.words} `{one.line}`, commit {record.commit}, {record.date} UTC.", record.cut_off, old]
    lines = [f"## {one.title}\n", " ".join(filter(None, said)) + "\n"]
    if record.rates or one.targets:
        lines += ["| figure | measured | share | 95 % interval | target |", "|---|---|---|---|---|"]
    for name, rate in record.rates.items():
        target = one.targets.get(name, "")
        if target:
            target += ": met" if met(target, rate) else ": **missed**"
        low, high = rate.interval
        share = f"{100 * rate.share:.1f} % | {100 * low:.1f} … {100 * high:.1f} %" if rate.n else "– | –"
        lines.append(f"| {name} | {rate.hits:,} of {rate.n:,} | {share} | {target} |")
    lines += [
        f"| {name} | not measured | | | {target} |"
        for name, target in one.targets.items()
        if name not in record.rates
    ]
    if one.picture:
        lines += ["", f"![{one.title}]({one.picture})"]
    printed = [
        "<details markdown><summary>All that it printed</summary>",
        "",
        "```",
        record.text,
        "```",
        "",
        "</details>",
    ]
    return "\n".join([*lines, "", *printed, ""])
