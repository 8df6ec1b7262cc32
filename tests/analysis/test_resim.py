"""A run is run again from its log alone: identical, or the first tick and field that are not."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from picktree.analysis import Run, RunChanges, resimulate, what_if
from picktree.analysis.compare.message_differences import MessageDifference
from picktree.analysis.resim import ResimAnswer, ResimOrder, notes, reasons, run_order
from picktree.files import PicktreeError
from picktree.logs import RunLog, RunResult
from picktree.logs.arithmetic_record import Arithmetic
from picktree.session import Observer, RunRequest, Session, environment
from picktree.session.mission_edits import MissionReload
from picktree.world import Tick

from ..rooms import ROOT, modules

WAVE = '''\
from picktree.trees import Skill
from picktree.world import Cause, Failure, register_cause

TIRED = register_cause(Cause("waving.tired", "The arm is tired.", "rest"))


class Wave(Skill):
    """Wave a few times."""

    causes = (TIRED,)

    def run(self, world):
        for _ in range(3):
            yield
        raise Failure(TIRED, "no more")


NODES = (Wave,)
'''
COMMON = """\
picktree: 1
kind: mission
library: true
plugins: [wave.py]
trees:
  Greet:
    ForceSuccess: Wave
"""
MISSION = """\
picktree: 1
kind: mission
scene: own.yaml
include: [common.yaml]
trees:
  Main:
    ports:
      pose: {type: string, default: home, doc: where to}
    Sequence:
      - Greet
      - Observe: {camera: overhead, objects: "{items}"}
      - GoTo: {pose: "{pose}"}
      - Grasp: {object: red_block_1}
      - Log: {message: hello}
"""
SCENE = """\
picktree: 1
kind: scene
base: sort_small
catalogue:
  lump: {mesh: parts/lump.obj, mass: 80 g, friction: 0.6}
"""
FAULTS = """\
picktree: 1
kind: faults
scene: own.yaml
faults:
  - {fault: friction, when: {at: 500 ms}, target: {index: 1}, friction: 0.2}
"""
CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 0.03) for y in (0, 0.03) for z in (0, 0.03)) + "".join(
    f"f {a} {b} {c}\n"
    for a, b, c in (
        (1, 2, 4), (1, 4, 3), (5, 7, 8), (5, 8, 6), (1, 5, 6), (1, 6, 2),
        (3, 4, 8), (3, 8, 7), (1, 3, 7), (1, 7, 5), (2, 6, 8), (2, 8, 4),
    )
)  # fmt: skip


def write_files(folder: Path) -> Path:
    (folder / "parts").mkdir(parents=True)
    for name, text in (
        ("greeting.yaml", MISSION), ("common.yaml", COMMON), ("wave.py", WAVE), ("own.yaml", SCENE),
        ("parts/lump.obj", CUBE), ("faults.yaml", FAULTS),
    ):  # fmt: skip
        (folder / name).write_text(text)
    return folder / "greeting.yaml"


def record(folder: Path, **options: object) -> RunResult:
    mission = write_files(folder / "files")
    request = RunRequest(
        mission,
        seed=3,
        faults=mission.parent / "faults.yaml",
        parameters={"pose": "home"},
        out=folder / "runs",
        backend="kinematic",
        **options,  # type: ignore[arg-type]
    )
    return Session(request).run()


@pytest.fixture(scope="module")
def greeting(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """A run whose files are all gone."""
    folder = tmp_path_factory.mktemp("greeting")
    result = record(folder)
    shutil.rmtree(folder / "files")
    return result


def again(log: Path, changes: RunChanges | None = None, until: float | None = None) -> ResimAnswer:
    """As the other process does it."""
    return run_order(ResimOrder(log, changes or RunChanges(), until, None), lambda _: None)


def test_a_run_is_made_again_from_its_log_alone(greeting: RunResult) -> None:
    answer = again(greeting.log)
    assert answer.difference is None
    assert answer.trees is None
    assert answer.exact
    assert answer.digest == greeting.digest
    with Run(greeting.log) as run:
        assert answer.ticks == len(run.ticks) > 30
        assert {visit.cause for visit in run.visits} >= {"waving.tired"}
        assert any(at.record.kind == "fault" for at in run.events)


def test_another_process_with_another_hash_seed_says_so(greeting: RunResult, tmp_path: Path) -> None:
    said: list[tuple[float, float]] = []
    found = resimulate(
        greeting.log, until="1s", out=tmp_path, progress=lambda now, end: said.append((now, end))
    )
    assert found.identical
    assert found.to_text().splitlines()[0] == (
        f"identical up to tick 20: 21 ticks, 1.00 simulated s, digest {found.digest[:16]}"
    )
    assert said[0] == (0.0, pytest.approx(1.0))
    assert found.kept is not None
    with Run(found.kept) as run:
        assert run.end == pytest.approx(1.0)
        assert run.log.attachment("mission.yaml").decode() == MISSION


def test_the_first_tick_and_field_that_differ_are_named(greeting: RunResult, tmp_path: Path) -> None:
    mission = write_files(tmp_path / "other")
    mission.write_text(MISSION.replace("message: hello", "message: good bye"))
    answer = again(greeting.log, RunChanges(mission=mission))
    assert answer.told == (
        "mission line 14: `- Log: {message: good bye}` instead of `- Log: {message: hello}`",
    )
    assert answer.trees is not None
    assert (answer.trees.field, answer.trees.a, answer.trees.b) == (
        "nodes[8].ports.message",
        "hello",
        "good bye",
    )
    with Run(greeting.log) as run:
        log = next(v for v in run.visits if v.id == "Log")
        assert answer.difference == MessageDifference(
            log.first, log.start, "/events", "", False, "message", "", "hello", "good bye"
        )
        assert answer.ticks == log.first


def test_a_new_node_makes_a_difference_when_it_begins(greeting: RunResult, tmp_path: Path) -> None:
    mission = write_files(tmp_path / "other")
    mission.write_text(MISSION.replace("- Greet\n", "- Greet\n      - AlwaysSuccess: {name: extra}\n"))
    answer = again(greeting.log, RunChanges(mission=mission))
    assert answer.trees is not None
    assert answer.difference is not None
    assert answer.difference.field == "transitions[3].path"
    assert answer.difference.a == "Main/Sequence/Observe"
    assert answer.difference.b == "Main/Sequence/extra"


def test_a_record_whose_mission_was_altered_is_found_out(
    greeting: RunResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = RunLog.attachment

    def altered(log: RunLog, name: str) -> bytes:
        data = held(log, name)
        return data.replace(b"{message: hello}", b"{message: hullo}") if name == "mission.yaml" else data

    monkeypatch.setattr(RunLog, "attachment", altered)
    answer = again(greeting.log)
    assert answer.difference is not None
    assert (answer.difference.topic, answer.difference.a, answer.difference.b) == (
        "/events",
        "hello",
        "hullo",
    )
    with Run(greeting.log) as run:
        now = run.info.arithmetic
        assert [str(reason) for reason in reasons(run, now)] == [
            "mission.yaml in the log differs from the version that was run"
        ]


def test_what_is_not_as_it_was_is_a_reason(greeting: RunResult, monkeypatch: pytest.MonkeyPatch) -> None:
    with Run(greeting.log) as run:
        now = run.info.arithmetic
        assert reasons(run, now) == ()
        sources = {**environment.sources(), "robot/control/control_loop.py": "0" * 12}
        monkeypatch.setattr(environment, "sources", lambda: sources)
        versions = {**run.info.versions, "pybullet": "9"}

        def versions_now(libraries: Iterable[str]) -> dict[str, str]:
            return {library: versions[library] for library in libraries}

        monkeypatch.setattr(environment, "versions", versions_now)
        elsewhere = replace(now, versions={**now.versions, "glibc": "2.41"})
        told = [str(reason) for reason in reasons(run, elsewhere)]
    glibc = now.versions["glibc"]
    assert told == [
        "picktree itself was changed in robot/control/control_loop.py",
        f"recorded with other arithmetic (glibc {glibc}, here 2.41): the runs may diverge",
        f"pybullet: {run.info.versions['pybullet']} then, 9 now",
    ]


def test_sources_that_moved_are_counted_and_not_listed() -> None:
    then = {f"world/{n}.py": f"{n:012}" for n in range(40)}
    stayed = dict(list(then.items())[:30])
    moved = {path.replace("world", "cell"): digest for path, digest in list(then.items())[30:]}
    edited = {path: f"{digest}+" for path, digest in moved.items()}

    def said(now: Mapping[str, str]) -> tuple[str, ...]:
        return environment.source_changes(then, now)

    assert said(then) == ()
    assert said(stayed | moved) == ("the source files have moved since the run (10 files were moved)",)
    assert said(stayed | edited) == (
        "the source files have moved since the run (10 files were moved, 10 of them changed)",
    )
    one = {"cell/39.py" if path == "world/39.py" else path: digest for path, digest in then.items()}
    assert said(one) == ("the source files have moved since the run (1 file was moved)",)
    few = dict(list(moved.items())[:8])
    assert said(stayed | {"world/3.py": "other"} | few) == (
        "the source files have moved since the run (8 files were moved)",
        "picktree itself was changed in world/3.py, world/38.py, world/39.py",
    )
    first = "world/0.py, world/1.py, world/10.py, world/11.py, world/12.py"
    assert said(dict.fromkeys(then, "other")) == (f"picktree itself was changed in {first} and 35 more",)


def test_the_sources_of_a_run_are_those_of_all_rooms_but_tools() -> None:
    left_out = environment._FILES_WITHOUT_EFFECT
    assert [name for name in left_out if not (ROOT / name).exists()] == []
    found = environment.sources()
    assert [path for path in found if path.startswith(left_out)] == []
    modules_there = {str(path.relative_to(ROOT)) for path in modules()}
    assert {path for path in found if path.endswith(".py")} == {
        path for path in modules_there if not path.startswith(left_out)
    }
    assert "trees/library/sorting.yaml" in found


def test_an_older_log_has_no_arithmetic_and_names_the_machine(
    greeting: RunResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(environment, "machine", lambda: {"processor": "abacus"})
    with Run(greeting.log) as run:
        now = run.info.arithmetic
        run.info = replace(run.info, arithmetic=Arithmetic(), machine={"processor": "slide rule"})
        told = [str(reason) for reason in reasons(run, now)]
    assert told == [
        "arithmetic not recorded: the log is of an older version",
        "processor: slide rule then, abacus now",
    ]


def test_a_file_that_was_edited_since_is_noted(tmp_path: Path) -> None:
    log = record(tmp_path, limit=0.3).log
    with Run(log) as run:
        assert notes(run) == ()
        (tmp_path / "files" / "greeting.yaml").write_text(MISSION + "# later\n")
        assert notes(run) == (
            f"{tmp_path}/files/greeting.yaml was edited after the run; the version in the log was run",
        )


class Editor:
    """Edits the mission after the tick of a time."""

    def __init__(self, file: Path, edits: Mapping[float, str]) -> None:
        self._file, self._edits = file, dict(edits)
        self.clock: Callable[[], float] = lambda: 0.0

    def watch(self, files: Iterable[Path]) -> None: ...

    def found(self) -> bool:
        due = [time for time in self._edits if self.clock() >= time - 1e-9]
        for time in due:
            self._file.write_text(self._edits.pop(time))
        return bool(due)


PARTS = """\
picktree: 1
kind: mission
scene: sort_small
trees:
  Main:
    ForEach:
      in: [1, 2, 3, 4]
      out: "{n}"
      do: {Part: {n: "{n}"}}
  Part:
    ports: {n: {type: int}}
    Sequence:
      - Log: {message: part, value: "{n}"}
      - GoTo: {pose: home}
"""


def test_edits_are_taken_over_at_the_same_ticks(tmp_path: Path) -> None:
    mission = tmp_path / "parts.yaml"
    mission.write_text(PARTS)
    first = PARTS.replace("message: part", "message: piece")
    second = first.replace("      - GoTo", "      - Log: {message: more}\n      - GoTo")
    editor = Editor(mission, {0.05: first, 0.2: second})
    request = RunRequest(mission, out=tmp_path, backend="kinematic")
    session = Session(request, observers=[MissionReload(editor)])
    editor.clock = lambda: session.execution.world.clock.now
    result = session.run()
    mission.unlink()
    with Run(result.log) as run:
        assert [at.record.kind for at in run.events].count("mission_edited") == 2
    answer = again(result.log)
    assert (answer.difference, answer.digest) == (None, result.digest)


def test_a_killed_run_is_the_same_up_to_its_last_tick(greeting: RunResult, tmp_path: Path) -> None:
    cut = tmp_path / "log.mcap"
    content = greeting.log.read_bytes()
    cut.write_bytes(content[: len(content) * 97 // 100])
    with Run(cut) as run:
        assert run.recovered
        last = run.ticks.times[-1]
        count = len(run.ticks)
    answer = again(cut)
    assert (answer.difference, answer.ticks) == (None, count)
    assert RunResult.from_json_text(answer.result, cut).sim_seconds == pytest.approx(last)


class Impatient(Observer):
    """Interrupts a run in the middle of a tick."""

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        if now > 0.5:
            raise KeyboardInterrupt


def test_an_interrupted_run_is_the_same_up_to_its_last_tick(tmp_path: Path) -> None:
    mission = write_files(tmp_path / "files")
    result = Session(
        RunRequest(mission, seed=3, out=tmp_path, backend="kinematic"), observers=[Impatient()]
    ).run()
    assert result.status == "interrupted"
    found = again(result.log)
    assert found.difference is None
    with Run(result.log) as run:
        assert found.ticks == len(run.ticks)


@pytest.mark.parametrize(
    ("until", "message"),
    [
        ("soon", "--until soon: write the number of a tick, as 412, or a time, as 20.6s"),
        ("100000", "--until 100000: the log ends with tick {last}, at {end:.2f} s"),
        ("90 min", "--until 90 min: the log ends with tick {last}, at {end:.2f} s"),
    ],
)
def test_a_moment_that_is_none_is_refused(greeting: RunResult, until: str, message: str) -> None:
    with Run(greeting.log) as run:
        last, end = len(run.ticks) - 1, run.ticks.times[-1]
    with pytest.raises(PicktreeError) as caught:
        resimulate(greeting.log, until=until)
    assert str(caught.value) == message.format(last=last, end=end)


def test_a_faulty_mission_is_refused_as_by_the_checker(greeting: RunResult, tmp_path: Path) -> None:
    mission = tmp_path / "bad.yaml"
    mission.write_text(MISSION.replace("{camera: overhead, ", "{camera: underhead, "))
    (tmp_path / "common.yaml").write_text(COMMON)
    (tmp_path / "wave.py").write_text(WAVE)
    with pytest.raises(PicktreeError, match="the scene 'own' has no camera 'underhead'"):
        again(greeting.log, RunChanges(mission=mission))


def test_a_log_of_format_2_is_read_and_not_repeated() -> None:
    log = Path(__file__).parents[1] / "logs" / "golden" / "format-2.mcap"
    for repeat in (lambda: resimulate(log), lambda: what_if(log, "0.5s")):
        with pytest.raises(PicktreeError) as raised:
            repeat()
        assert str(raised.value).startswith(
            f"{log}: the log has format 2, and this version repeats format 3; repeat it with the version"
        )
