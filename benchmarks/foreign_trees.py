"""Import of other people's behaviour trees: how many files of a folder come in, and why the others do not.

`python -m picktree.benchmarks.foreign_trees FOLDER` imports each distinct XML file with trees below the
folder: by itself, with stubs, and with the other files of its folder, which may hold its sub-trees. The
mission must load with the stubs, and what goes out again must come in as the same. Nothing is kept.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import traceback
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from picktree.authoring.xml.conversion import convert, convert_all, read_files
from picktree.authoring.xml.importing.mission_import import ImportOptions
from picktree.authoring.xml.importing.source import XmlText
from picktree.errors import PicktreeError
from picktree.files.marks import FileError
from picktree.files.yaml.file_text import read_text
from picktree.trees.loading.loader import load_mission
from picktree.trees.loading.registry import NodeRegistry

_NAMES = re.compile(r"'[^']*'|\{[^}]*\}|\d+")
_STUBS = ImportOptions(stubs="nodes.py")


@dataclass
class Tally:
    """Number of files by outcome, and the reasons of refusals with stubs."""

    files: int = 0
    alone: int = 0
    strict: int = 0
    stubbed: int = 0
    together: int = 0
    loaded: int = 0
    """Files whose mission loads with the written stubs."""
    again: int = 0
    """Files whose mission goes out and in again, and is then written as the same XML."""
    crashed: list[str] = field(default_factory=list[str])
    reasons: Counter[str] = field(default_factory=Counter[str])
    examples: dict[str, str] = field(default_factory=dict[str, str])

    def text(self) -> str:
        lines = [
            f"{self.files} distinct files with trees",
            f"{self.strict} come in as they are, without a note (--strict)",
            f"{self.alone} come in as they are",
            f"{self.stubbed} come in with stubs; {self.loaded} missions load, {self.again} go out and in",
            f"{self.together} come in with stubs, and with the files beside them",
            f"{self.files - self.together} are refused, for these reasons (a file may have several):",
        ]
        lines += [f"  {count:4}  {why}  ({self.examples[why]})" for why, count in self.reasons.most_common()]
        return "\n".join([*lines, *(f"CRASHED: {each}" for each in self.crashed)])


def faults_of(files: list[XmlText], options: ImportOptions) -> list[str] | None:
    """Return what keeps files from being imported, without names; None when nothing does."""
    try:
        convert_all(files, options)
    except FileError as error:
        return [
            f"{fault.code} {_NAMES.sub('…', fault.message)}"
            for fault in error.faults
            if fault.severity == "error"
        ]
    except PicktreeError as error:
        return [_NAMES.sub("…", str(error))]
    return None


def loads(files: list[XmlText]) -> bool:
    """Whether the loader takes the mission with its plug-in."""
    with TemporaryDirectory() as folder:
        try:
            load_mission(written(files, Path(folder)), NodeRegistry())
        except FileError:
            return False
    return True


def survives(files: list[XmlText]) -> bool:
    """Whether the mission goes out and in again, and is the same XML from then on."""
    with TemporaryDirectory() as folder:
        mission = written(files, Path(folder))
        out, again = mission.with_name("out.xml"), mission.with_name("again.yaml")
        try:
            out.write_text(convert(mission, NodeRegistry()), encoding="utf-8")
            again.write_text(convert(out, NodeRegistry()), encoding="utf-8")
            return convert(again, NodeRegistry()) == out.read_text(encoding="utf-8")
        except FileError:
            return False


def written(files: list[XmlText], folder: Path) -> Path:
    """Write mission and stubs; return the mission's file."""
    found = convert_all(files, _STUBS)
    (folder / "mission.yaml").write_text(found.text, encoding="utf-8")
    (folder / "nodes.py").write_text(found.stubs, encoding="utf-8")
    return folder / "mission.yaml"


def first_tree(text: str) -> str:
    """Return the ID of the tree that a file begins with; empty when it does not say so."""
    match = re.search(r'main_tree_to_execute\s*=\s*"([^"]+)"', text)
    trees = re.findall(r'<BehaviorTree\s[^>]*?ID="([^"]+)"', text)
    return match[1] if match else trees[0] if trees else ""


def count(path: Path, tally: Tally) -> None:
    """Import one file in each way."""
    text = read_text(path)
    alone = [XmlText(text, path)]
    tally.files += 1
    tally.strict += faults_of(alone, ImportOptions(strict=True)) is None
    tally.alone += faults_of(alone, ImportOptions()) is None
    faults = faults_of(alone, _STUBS)
    tally.stubbed += faults is None
    if faults is None:
        tally.loaded, tally.again = tally.loaded + loads(alone), tally.again + survives(alone)
    if faults is not None and any(fault.startswith(("P913", "P914")) for fault in faults):
        beside = [file for file in read_files([path.parent]) if file.path != path]
        options = ImportOptions(stubs="nodes.py", main=first_tree(text))
        faults = faults_of([*alone, *beside], options)
    tally.together += faults is None
    for why in dict.fromkeys(faults or ()):
        tally.reasons[why] += 1
        tally.examples.setdefault(why, path.name)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder: Path = parser.parse_args().folder
    tally, seen = Tally(), set[str]()
    for path in sorted(folder.rglob("*.xml")):
        raw = path.read_bytes()
        digest = hashlib.sha256(b"".join(raw.split())).hexdigest()
        if b"<BehaviorTree" not in raw or digest in seen:
            continue
        seen.add(digest)
        try:
            count(path, tally)
        except FileError as error:
            tally.files += 1
            tally.reasons[f"{error.faults[0].code} unreadable"] += 1
            tally.examples.setdefault(f"{error.faults[0].code} unreadable", path.name)
        except Exception:  # noqa: BLE001 - what is looked for
            tally.crashed.append(f"{path}: {traceback.format_exc(limit=-3)}")
    print(tally.text())


if __name__ == "__main__":
    main()
