"""Import of other people's behaviour trees: how many files come in, and why the others do not.

python benchmarks/foreign_trees.py CLONES --manifest benchmarks/foreign_trees.toml
python benchmarks/foreign_trees.py FOLDER

CLONES has a clone of each repository of the manifest, as OWNER/NAME; the XML files of the commit are read.
FOLDER is read as it is. Each distinct file with trees is imported by itself, and with stubs together with the
files beside it that hold its sub-trees. The mission must load with the stubs, and what goes out again must
come in as the same.

Where BTCPP_PREFIX names the place of BehaviorTree.CPP, each file is loaded there, too, and ticked as it is
and as it comes out again. Nothing is kept.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import os
import re
import subprocess
import tomllib
import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from picktree.authoring.xml import ImportOptions, XmlText, convert_all
from picktree.authoring.xml.conversion import convert_text
from picktree.files import FileError, PicktreeError
from picktree.files.yaml.file_text import read_text
from picktree.logs import rate
from picktree.tests.authoring.btcpp_library import LIBRARY
from picktree.tests.authoring.foreign_library import Library, called_by, comparable, trees_of
from picktree.trees.loading import NodeRegistry, load_mission

_NAMES = re.compile(r"'[^']*'|\"[^\"]*\"|\{[^}]*\}|`[^`]*`|\d+")
_PATHS = re.compile(r"\S*/\S*")
_MAIN = re.compile(r"""main_tree_to_execute\s*=\s*["']([^"']+)""")
_INCLUDED = re.compile(r"""<include\b[^>]*?\bpath\s*=\s*["']([^"']+)""")


@dataclass
class Tally:
    """Number of files by outcome, and the reasons of refusals."""

    counts: Counter[str] = field(default_factory=Counter[str])
    crashed: list[str] = field(default_factory=list[str])
    ours: dict[str, dict[str, str]] = field(default_factory=dict[str, dict[str, str]])
    """First file by our reason and by what the library says."""
    refusals: Counter[tuple[str, str]] = field(default_factory=Counter[tuple[str, str]])
    different: list[str] = field(default_factory=list[str])

    def refuse(self, why: str, file: str, *, loads: bool) -> None:
        which = "loads" if loads else "refused"
        self.refusals[which, why] += 1
        self.ours.setdefault(which, {}).setdefault(why, file)

    def text(self, *, library: bool) -> str:
        """Return the report."""
        files = self.counts["files"]
        lines = [
            f"{files} distinct files with trees",
            self._line("as they are, without a note (--strict)", "strict", "files"),
            self._line("as they are", "alone", "files"),
            self._line("with stubs, together with the files beside them", "imported", "files"),
            self._line("their missions load", "loaded", "imported"),
            self._line("they go out and in again as the same", "again", "imported"),
        ]
        if library:
            lines += [
                "",
                self._line("loaded by BehaviorTree.CPP", "theirs", "files"),
                f"  {self.counts['renamed']} of these once '_' stands for what 4.10 forbids in names",
                self._line("of these as they are", "theirs alone", "theirs"),
                self._line("of these with stubs", "theirs imported", "theirs"),
                self._line("of these loaded there again as they come out", "out loads", "theirs imported"),
                self._line("ticked alike before and after", "alike", "compared"),
                f"  in {self.counts['ticks']} ticks, with {self.counts['answers']} answers of leaves",
            ]
            lines += [f"  DIFFERENT {each}" for each in self.different]
        for which, heading in (
            ("loads", "refused, though BehaviorTree.CPP loads them"),
            ("refused", "refused"),
        ):
            found = [(n, why) for (kind, why), n in self.refusals.most_common() if kind == which]
            lines += ["", f"{heading}, by reason:"] if found else []
            lines += [f"  {n:4}  {why}  ({self.ours[which][why]})" for n, why in found]
        return "\n".join([*lines, *(f"CRASHED: {each}" for each in self.crashed)])

    def _line(self, what: str, of: str, among: str) -> str:
        hits, total = self.counts[of], self.counts[among]
        return f"{what}: {rate(hits, total)}"


class Corpus:
    """XML files with trees below a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._homes: dict[Path, dict[str, Path]] = {}
        """Files by the trees that they hold, by folder."""

    def distinct(self) -> Iterator[Path]:
        """Yield the files with trees, of files that are alike but for white space one."""
        seen: set[str] = set()
        for path in sorted(self._folder.rglob("*.xml")):
            raw = path.read_bytes() if path.is_file() else b""
            digest = hashlib.sha256(b"".join(raw.split())).hexdigest()
            if b"<BehaviorTree" in raw and digest not in seen:
                seen.add(digest)
                yield path

    def with_sub_trees(self, path: Path) -> list[XmlText]:
        """Return a file, and those that it includes or that hold its sub-trees."""
        found: dict[Path, XmlText] = {}
        todo = [path]
        while todo:
            one = todo.pop(0)
            if one in found:
                continue
            text = read_text(one)
            known = {name for file in found.values() for name in trees_of(file.text)}
            if known & set(trees_of(text)):
                continue  # another tree of that name is meant
            found[one] = XmlText(text, one)
            todo += [p for each in _INCLUDED.findall(text) if (p := (one.parent / each).resolve()).is_file()]
            own = {name for file in found.values() for name in trees_of(file.text)}
            homes = self._beside(path.parent)
            todo += [homes[name] for name in sorted(called_by(text) - own) if name in homes]
        return list(found.values())

    def _beside(self, folder: Path) -> dict[str, Path]:
        if folder not in self._homes:
            self._homes[folder] = {}
            for path in sorted(folder.rglob("*.xml")):
                if path.is_file() and b"<BehaviorTree" in path.read_bytes():
                    for name in trees_of(path.read_text(encoding="utf-8", errors="replace")):
                        self._homes[folder].setdefault(name, path)
        return self._homes[folder]


def faults_of(files: list[XmlText], options: ImportOptions) -> list[str] | None:
    """Return what keeps files from being imported, without names; None when nothing does."""
    try:
        convert_all(files, options)
    except FileError as error:
        errors = [fault for fault in error.faults if fault.severity == "error"]
        return [f"{fault.code} {_PATHS.sub('…', _NAMES.sub('…', fault.message))[:110]}" for fault in errors]
    except PicktreeError as error:
        return [_NAMES.sub("…", str(error))]
    return None


def imported(path: Path, files: list[XmlText], main: str, tally: Tally, library: Library | None) -> None:
    """Load the mission of files that come in, and send it out and in again; compare the ticks."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        found = convert_all(files, ImportOptions(stubs="nodes.py", main=main))
        mission = folder / "mission.yaml"
        mission.write_text(found.text, encoding="utf-8")
        (folder / "nodes.py").write_text(found.stubs, encoding="utf-8")
        try:
            load_mission(mission, NodeRegistry())
            tally.counts["loaded"] += 1
            out, again = folder / "out.xml", folder / "again.yaml"
            xml = convert_text(read_text(mission), mission, NodeRegistry())
            out.write_text(xml, encoding="utf-8")
            again.write_text(convert_text(read_text(out), out, NodeRegistry()), encoding="utf-8")
            tally.counts["again"] += convert_text(read_text(again), again, NodeRegistry()) == xml
        except FileError as error:
            tally.different.append(f"{path}: {error.faults[0].code} {error.faults[0].message[:150]}")
            return
    if library is not None:
        compare(path, files, main, xml, tally, library)


def compare(path: Path, files: list[XmlText], main: str, xml: str, tally: Tally, library: Library) -> None:
    """Tick what BehaviorTree.CPP loads, as it is and as it comes out again."""
    if library.refuses(files, main):
        return
    before = library.ticks(0)
    why = library.refuses_ours(xml)
    tally.counts["out loads"] += not why
    if why:
        tally.different.append(f"{path}: {why[:200]}")
    elif comparable(xml, [file.text for file in files]):
        after = library.ticks(0)
        tally.counts["compared"] += 1
        tally.counts["ticks"] += len(before)
        tally.counts["answers"] += sum(tick.count(":") for tick in before)
        tally.counts["alike"] += before == after
        if before != after:
            at = next(i for i, pair in enumerate(zip(before, after, strict=False)) if pair[0] != pair[1])
            tally.different.append(f"{path}: tick {at}: {before[at][:100]} | {after[at][:100]}")


def first_tree(text: str) -> str:
    """Return the ID of the tree that a file begins with; empty when it does not say so."""
    match = _MAIN.search(text)
    trees = trees_of(text)
    return match[1] if match and match[1] in trees else trees[0] if trees else ""


def count(path: Path, corpus: Corpus, tally: Tally, library: Library | None) -> None:
    """Import one file in each way."""
    tally.counts["files"] += 1
    files = corpus.with_sub_trees(path)
    alone, main = files[:1], first_tree(files[0].text)
    loads = library is not None and library.refuses(files, main) == ""
    if library is not None:
        tally.counts["renamed"] += library.renamed and loads
    by_itself = faults_of(alone, ImportOptions()) is None
    tally.counts["strict"] += faults_of(alone, ImportOptions(strict=True)) is None
    tally.counts["alone"] += by_itself
    tally.counts["theirs"] += loads
    tally.counts["theirs alone"] += loads and by_itself
    faults = faults_of(files, ImportOptions(stubs="nodes.py", main=main))
    if faults is None:
        tally.counts["imported"] += 1
        tally.counts["theirs imported"] += loads
        imported(path, files, main, tally, library)
    for why in dict.fromkeys(faults or ()):
        tally.refuse(why, f"{path.parent.name}/{path.name}", loads=loads)


def fill(folder: Path, clones: Path, manifest: Path) -> None:
    """Write the XML files of the manifest's commits to a folder."""
    for each in tomllib.loads(manifest.read_text(encoding="utf-8"))["repository"]:
        clone = clones / each["name"]
        if not clone.exists():
            raise PicktreeError(f"there is no clone {clone}; the manifest has it at {each['commit']}")
        git = ["git", "-C", str(clone.resolve())]
        listed = subprocess.run(
            [*git, "ls-tree", "-r", "-z", "--name-only", each["commit"]], check=True, capture_output=True
        )
        names = [name for name in listed.stdout.decode().split("\0") if name.endswith(".xml")]
        asked = "".join(f"{each['commit']}:{name}\n" for name in names).encode()
        read = subprocess.run([*git, "cat-file", "--batch"], input=asked, check=True, capture_output=True)
        stream = io.BytesIO(read.stdout)
        for name in names:
            head = stream.readline().decode().split()
            if head[-1].isdigit():  # a file may be missing in a clone without large files
                path = folder / each["name"] / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(stream.read(int(head[-1])))
                stream.readline()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="clones, or XML files")
    parser.add_argument("--manifest", type=Path, metavar="TOML", help="repositories with their commits")
    given = parser.parse_args()
    tally = Tally()
    with ExitStack() as stack:
        folder: Path = given.folder
        if given.manifest is not None:
            folder = Path(stack.enter_context(TemporaryDirectory()))
            fill(folder, given.folder, given.manifest)
        corpus, library = Corpus(folder), None
        if LIBRARY.present:
            place = Path(stack.enter_context(TemporaryDirectory()))
            library = stack.enter_context(Library(place))
        for path in corpus.distinct():
            try:
                count(path, corpus, tally, library)
            except FileError as error:
                tally.refuse(f"{error.faults[0].code} unreadable", path.name, loads=False)
            except Exception:  # noqa: BLE001 - what is looked for
                tally.crashed.append(f"{path}: {traceback.format_exc(limit=-3)}")
    print(tally.text(library=LIBRARY.present))
    if os.environ.get("BTCPP_PREFIX") is None:
        print("BehaviorTree.CPP is not compared: BTCPP_PREFIX does not say where it is")


if __name__ == "__main__":
    main()
