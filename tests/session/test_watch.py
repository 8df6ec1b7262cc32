"""A mission that is edited while it runs: taken over between items, or refused with what is wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import pytest

from picktree.logs import RunLog, RunResult
from picktree.session import Execution, Observer, RunRequest, Session
from picktree.session.mission_edits import FileWatch, MissionReload
from picktree.world import Tick

SORTING = """\
picktree: 1
kind: mission
name: sorting
scene: two.yaml
trees:
  Main:
    Repeat:
      while: items_left
      num_cycles: 2
      do:
        Sequence:
          - Observe: {camera: overhead, objects: "{items}"}
          - ForEach: {in: "{items}", out: "{item}", on_failure: continue, do: {SortOne: {item: "{item}"}}}
          - GoTo: {pose: home}
  SortOne:
    ports: {item: {type: object}}
    Sequence:
      - Grasp: {object: "{item}"}
      - Place: {object: "{item}", into: "{item.destination}"}
"""
TWO_ITEMS = """\
picktree: 1
kind: scene
base: sort_small
spawn: [{of: {block: 1, plate: 1}, colours: [red, blue], area: {min: [0.4, -0.15], max: [0.6, 0.15]}}]
"""
MISSION = """\
picktree: 1
kind: mission
name: quick
scene: sort_small
trees:
  Main:
    ports:
      pose: {type: string, default: home, doc: where to}
    ForEach:
      in: [1, 2, 3, 4]
      out: "{n}"
      do: {Part: {n: "{n}", pose: "{pose}"}}
  Part:
    ports: {n: {type: int}, pose: {type: string}}
    Sequence:
      - Log: {message: part, value: "{n}"}
      - GoTo: {pose: "{pose}"}
"""
LOGGED = MISSION.replace("      - GoTo", "      - Log: {message: edited}\n      - GoTo")


class Editor:
    """Edits files after the tick of a time, and tells the session at once: no wall clock is involved."""

    def __init__(self, folder: Path, edits: Mapping[float, Mapping[str, str]]) -> None:
        self._folder, self._edits = folder, dict(edits)
        self.clock: Callable[[], float] = lambda: 0.0

    def watch(self, files: Iterable[Path]) -> None: ...

    def found(self) -> bool:
        due = [time for time in self._edits if self.clock() >= time - 1e-9]
        for time in due:
            for name, text in self._edits.pop(time).items():
                (self._folder / name).write_text(text)
        return bool(due)


class Witness(Observer):
    """What a session tells whoever looks on."""

    def __init__(self) -> None:
        self.said: list[tuple[float, str]] = []
        self.structures: list[frozenset[str]] = []
        self.ran: list[tuple[float, frozenset[str]]] = []

    def started(self, run: Execution, folder: Path) -> None:
        self.edited(run)

    def edited(self, run: Execution) -> None:
        self.structures.append(frozenset(node.path for node in run.tree.structure()))

    def notified(self, now: float, text: str) -> None:
        self.said.append((round(now, 2), text))

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        assert {node.path for node in report.nodes} == self.structures[-1]

    def heard(self, folder: Path) -> list[tuple[float, str]]:
        return [(time, text.replace(str(folder), "")) for time, text in self.said]


def run(
    folder: Path, edits: Mapping[float, Mapping[str, str]], text: str = MISSION, **options: object
) -> tuple[RunResult, Witness]:
    (folder / "m.yaml").write_text(text)
    request = RunRequest(mission=folder / "m.yaml", out=folder / "runs", backend="kinematic", **options)  # type: ignore[arg-type]
    editor, witness = Editor(folder, edits), Witness()
    session = Session(request, observers=[witness, MissionReload(editor)])
    editor.clock = lambda: session.execution.world.clock.now
    return session.run(), witness


@pytest.fixture(scope="module")
def untouched(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """The same mission when nobody edits it."""
    folder = tmp_path_factory.mktemp("untouched")
    (folder / "m.yaml").write_text(MISSION)
    return Session(RunRequest(mission=folder / "m.yaml", out=folder, backend="kinematic")).run()


def test_an_edit_is_taken_over_between_two_items_and_the_loop_goes_on(tmp_path: Path) -> None:
    edited = SORTING.replace("      - Grasp", "      - Log: {message: edited}\n      - Grasp")
    (tmp_path / "two.yaml").write_text(TWO_ITEMS)
    result, witness = run(tmp_path, {2.0: {"m.yaml": edited}}, SORTING)
    assert (result.status, result.items.sorted, result.picks.tried) == ("success", 2, 2)
    taken = witness.said[1][0]
    assert witness.said == [
        (2.0, "the edit is good; it is taken over between two items"),
        (taken, "the edited mission takes over: 10 nodes go on, 1 begin anew, 0 are gone"),
    ]
    with RunLog(result.log) as log:
        (event,) = (e for e in log.events() if e.record.kind == "mission_edited")
        assert event.time == pytest.approx(taken)
        assert event.record.data["files"] == "edit-0001"
        assert event.record.data["fresh"] == ["Main/Repeat/Sequence/ForEach/SortOne/Sequence/Log"]
        first, second = log.trees()
        assert (first.time, second.time) == (0.0, pytest.approx(taken))
        assert len(second.record.nodes) == len(first.record.nodes) + 1
        assert log.tree() == first.record
        assert log.attachment("mission.yaml").decode() == SORTING
        assert log.attachment("edit-0001/mission.yaml").decode() == edited
        # Every tick is of the tree that was written last.
        for tick in log.ticks():
            tree = second if tick.time >= second.time - 1e-9 else first
            assert [n.path for n in tick.record.nodes] == [n.path for n in tree.record.nodes]
        # The list of items was read once, and each of them came up once, the first in the old version.
        items = [w.value for t in log.ticks() for w in t.record.writes if w.key == "Main/item"]
        lists = [w.value for t in log.ticks() for w in t.record.writes if w.key == "Main/items"]
        assert lists == [items]
        assert len([e for e in log.events() if e.record.kind == "log"]) == 1
        assert log.digest() == result.digest


def test_a_watched_run_that_nobody_edits_is_the_same_run(tmp_path: Path, untouched: RunResult) -> None:
    result, witness = run(tmp_path, {})
    assert witness.said == []
    assert result.digest == untouched.digest
    watched = RunRequest(mission=tmp_path / "m.yaml", out=tmp_path, backend="kinematic", watch=True)
    assert Session(watched).run().digest == untouched.digest


GOOD = "the edit is good; it is taken over between two items"
BAD = "the edit is not taken over:"
TAKEN = "the edited mission takes over: 6 nodes go on, 1 begin anew, 0 are gone"


def test_a_faulty_edit_is_told_and_ignored(tmp_path: Path, untouched: RunResult) -> None:
    result, witness = run(tmp_path, {0.1: {"m.yaml": LOGGED.replace("GoTo:", "GotO:")}})
    assert result.digest == untouched.digest
    assert witness.heard(tmp_path) == [
        (
            0.1,
            f"""\
{BAD}
/m.yaml:18:9: error P207: Part/Sequence: unknown node 'GotO' (did you mean 'GoTo'?)
   18 |       - GotO: {{pose: "{{pose}}"}}
      |         ^""",
        )
    ]
    with RunLog(result.log) as log:
        assert log.attachment("refused-0001.txt").decode() == witness.said[0][1]
        assert len(list(log.trees())) == 1


def test_a_mended_edit_is_taken_and_so_are_several(tmp_path: Path) -> None:
    faulty, more = LOGGED.replace("GoTo:", "GotO:"), LOGGED.replace("- GoTo", "- AlwaysSuccess\n      - GoTo")
    edits = {0.05: {"m.yaml": faulty}, 0.1: {"m.yaml": LOGGED}, 0.2: {"m.yaml": more}}
    result, witness = run(tmp_path, edits)
    assert [text.splitlines()[0] for _, text in witness.said] == [
        BAD, GOOD, TAKEN, GOOD, TAKEN.replace("6", "7")
    ]  # fmt: skip
    with RunLog(result.log) as log:
        assert log.attachment("edit-0001/mission.yaml").decode() == LOGGED
        assert log.attachment("edit-0002/mission.yaml").decode() == more
        said = [e.record.message for e in log.events() if e.record.kind == "log"]
        assert said == ["part: 1", "part: 2", "edited", "part: 3", "edited", "part: 4", "edited"]


def test_an_edit_that_is_undone_before_it_is_taken_over_is_none(tmp_path: Path, untouched: RunResult) -> None:
    result, witness = run(tmp_path, {0.05: {"m.yaml": LOGGED}, 0.1: {"m.yaml": MISSION}})
    assert witness.said == [(0.05, GOOD)]
    assert result.digest == untouched.digest


def test_the_last_good_edit_is_taken_although_a_faulty_one_follows(tmp_path: Path) -> None:
    _, witness = run(tmp_path, {0.05: {"m.yaml": LOGGED}, 0.1: {"m.yaml": "trees: {"}})
    assert [text.splitlines()[0] for _, text in witness.said] == [GOOD, BAD, TAKEN]


REFUSED = {
    "another scene": (
        MISSION.replace("scene: sort_small", "scene: three_bins"),
        "/m.yaml:4:8: the scene is three_bins now, and this run has sort_small: that needs a new run",
    ),
    "another default of a parameter": (
        MISSION.replace("default: home", "default: observe"),
        "/m.yaml:8:7: the mission's parameter 'pose' differs from its value at the start; such a "
        "change needs a new run",
    ),
    "a new parameter": (
        MISSION.replace("doc: where to}", "doc: where to}\n      speed: {type: float, default: 1}"),
        "/m.yaml:8:7: the mission's parameter 'speed' differs from its value at the start; such a "
        "change needs a new run",
    ),
    "a parameter less": (
        MISSION.replace('pose: "{pose}"}}', "pose: home}}").replace(
            "    ports:\n      pose: {type: string, default: home, doc: where to}\n", ""
        ),
        "/m.yaml:7:5: the mission's parameter 'pose' differs from its value at the start; such a "
        "change needs a new run",
    ),
    "a library": (
        MISSION.replace("name: quick\nscene: sort_small", "library: true").replace("Main:", "Other:"),
        "/m.yaml: this is a library now; a mission has a tree 'Main'",
    ),
}  # fmt: skip


@pytest.mark.parametrize("edit", REFUSED)
def test_an_edit_that_needs_a_new_run_is_refused(tmp_path: Path, edit: str) -> None:
    text, message = REFUSED[edit]
    _, witness = run(tmp_path, {0.1: {"m.yaml": text}}, limit=0.2)
    assert witness.heard(tmp_path) == [(0.1, f"the edit is not taken over: {message}")]


def test_what_is_said_of_a_parameter_and_the_goal_may_be_edited(tmp_path: Path) -> None:
    text = MISSION.replace("where to", "the pose to go to").replace("name: quick", "goal: sorted == 0")
    result, witness = run(tmp_path, {0.1: {"m.yaml": text}}, parameters={"pose": "home"})
    assert witness.said[-1][1] == TAKEN.replace("1 begin", "0 begin")
    assert result.status == "success"


def test_a_scene_given_on_the_command_line_stays_whatever_the_mission_says(tmp_path: Path) -> None:
    text = LOGGED.replace("scene: sort_small", "scene: nowhere")
    _, witness = run(tmp_path, {0.1: {"m.yaml": text}}, scene="sort_small")
    assert witness.said[-1][1] == TAKEN
    text = MISSION.replace('GoTo: {pose: "{pose}"}', "Observe: {camera: overhaed, objects: '{o}'}")
    _, witness = run(tmp_path, {0.1: {"m.yaml": text}}, scene="sort_small", limit=0.2)
    assert witness.heard(tmp_path)[0][1].splitlines()[1] == (
        "/m.yaml:17:27: error P240: Part/Sequence/Observe: port 'camera': the scene 'sort_small' has no "
        "camera 'overhaed' (did you mean 'overhead'?)"
    )


INCLUDING = MISSION[: MISSION.index("  Part:")].replace("trees:", "include: [parts.yaml]\ntrees:")
PARTS = f"picktree: 1\nkind: mission\nlibrary: true\ntrees:\n{MISSION[MISSION.index('  Part:') :]}"


def test_an_included_file_may_be_edited(tmp_path: Path) -> None:
    (tmp_path / "parts.yaml").write_text(PARTS)
    edited = PARTS.replace("- GoTo", "- Log: {message: edited}\n      - GoTo")
    result, witness = run(tmp_path, {0.1: {"parts.yaml": edited}}, INCLUDING)
    assert witness.said[-1][1] == TAKEN
    with RunLog(result.log) as log:
        assert log.attachment("include/parts.yaml").decode() == PARTS
        assert log.attachment("edit-0001/include/parts.yaml").decode() == edited


PLUGIN = '''\
from picktree.trees import Skill
class Pause(Skill):
    """Wait a moment."""
    def run(self, world):
        for _ in range(2):
            yield
NODES = (Pause,)
'''


def test_a_plug_in_may_be_edited_and_a_broken_one_is_told(tmp_path: Path) -> None:
    (tmp_path / "pause.py").write_text(PLUGIN)
    text = MISSION.replace("trees:", "plugins: [pause.py]\ntrees:").replace("- GoTo", "- Pause\n      - GoTo")
    longer = PLUGIN.replace("range(2)", "range(20)")
    result, witness = run(tmp_path, {0.05: {"pause.py": f"{PLUGIN}1/0\n"}, 0.1: {"pause.py": longer}}, text)
    assert [said.splitlines()[0] for _, said in witness.said] == [
        BAD, GOOD, "the edited mission takes over: 7 nodes go on, 0 begin anew, 0 are gone"
    ]  # fmt: skip
    assert 'pause.py", line 8, in <module>' in witness.said[0][1]
    with RunLog(result.log) as log:
        assert log.attachment("plugin/pause.py").decode() == PLUGIN
        assert log.attachment("edit-0001/plugin/pause.py").decode() == longer
        nodes = [
            n for t in log.ticks() for n in t.record.nodes if n.path == "Main/ForEach/Part/Sequence/Pause"
        ]
    assert [n.status for n in nodes].count("RUNNING") == 2 + 3 * 20


def test_an_edited_scene_file_is_for_the_next_run(tmp_path: Path) -> None:
    scene = "picktree: 1\nkind: scene\nbase: sort_small\n"
    (tmp_path / "cell.yaml").write_text(scene)
    text = MISSION.replace("scene: sort_small", "scene: cell")
    _, witness = run(tmp_path, {0.1: {"cell.yaml": scene + "limits: {force: 50 N}\n"}}, text, limit=0.2)
    assert witness.heard(tmp_path) == [
        (0.1, "/cell.yaml: the scene was edited; this run keeps the old one, a new run has the edit")
    ]


class EditingWitness(Witness):
    """Edits the mission after a tick, and leaves it to the session to notice."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self._file = file

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        if round(now, 2) == 0.05:
            self._file.write_text(LOGGED)


def test_the_session_notices_an_edit_on_the_disk(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(MISSION)
    witness = EditingWitness(tmp_path / "m.yaml")
    request = RunRequest(mission=tmp_path / "m.yaml", out=tmp_path, backend="kinematic")
    Session(request, observers=[witness, MissionReload(FileWatch(period=0.0))]).run()
    assert [said for _, said in witness.said] == [GOOD, TAKEN]


def test_the_disk_is_looked_at_a_few_times_a_second_and_an_edit_counts_when_it_stands(tmp_path: Path) -> None:
    file, other = tmp_path / "a", tmp_path / "b"
    file.write_text("1")
    now = 0.0
    edits = FileWatch(period=0.25, wall=lambda: now)
    edits.watch([file, other])

    def after(seconds: float) -> bool:
        nonlocal now
        now += seconds
        return edits.found()

    assert not after(0.0)
    file.write_text("2")
    assert not after(0.2)  # nobody looks yet
    assert not after(0.1)  # seen, and perhaps not finished
    file.write_text("23")
    assert not after(0.25)  # indeed
    assert after(0.25)
    assert not after(0.25)
    other.write_text("new")
    assert not after(0.25)
    assert after(0.25)
    file.unlink()
    assert not after(0.25)
    file.write_text("23")  # an editor that writes a file anew
    assert not after(0.25)
    assert not after(0.25)
    file.write_text("24")
    edits.watch([file])
    assert not after(0.25)
    assert not after(0.25)
