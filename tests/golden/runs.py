"""Golden runs: short runs whose digests are recorded in `digests.json`.

    python tests/golden/runs.py                 # all of them, one JSON object a line
    python tests/golden/runs.py insert walls    # these
    python tests/golden/runs.py --write         # record all digests again: `make golden`

Together they go through physics and kinematics, three arms, contact, feeds, faults, noise, a resumed run,
planning around obstacles and a robot in MuJoCo. All of it happens in this process, so that an emulator of
another processor sees it.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
import zlib
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread

from picktree.files import restart
from picktree.logs import Topic, topics
from picktree.session import Observer, ResumeRequest, Resumption, RunRequest, Session, arithmetic
from picktree.session.run_recipe import DEFAULT_TIME_LIMIT
from picktree.simulation import Backend

HERE = Path(__file__).parent
RECORD = HERE / "digests.json"


@dataclass(frozen=True)
class Golden:
    """A short run. `mission`, `scene` and `faults` are stems of files in this folder."""

    mission: str
    shows: tuple[str, ...]
    """What its log must hold for it to be worth recording. Each is the beginning of an event, as
    `kind: message`, or of a plan, as `plan: planner`."""
    scene: str | None = None
    """None: the mission's own."""
    faults: str | None = None
    robot: str | None = None
    """None: the scene's own."""
    backend: Backend = "physics"
    interrupted: float | None = None
    """Simulated s after which the run ends, to be resumed from its last checkpoint. None: it is one run."""
    in_cell: bool = False
    """Whether the robot is one of `picktree_cell`, in lockstep."""

    def request(self, out: Path, robot_at: str = "") -> RunRequest:
        return RunRequest(
            HERE / f"{self.mission}.yaml",
            scene=str(HERE / f"{self.scene}.yaml") if self.scene else None,
            robot=self.robot,
            faults=HERE / f"{self.faults}.yaml" if self.faults else None,
            out=out,
            backend=self.backend,
            limit=self.interrupted or DEFAULT_TIME_LIMIT,
            robot_at=robot_at,
        )


_PICK = ("pick: red_can_1: held", "item_done: red_can_1")
GOLDEN: Mapping[str, Golden] = {
    "pick": Golden("one_item", _PICK),
    "pick_xarm6": Golden("one_item", _PICK, robot="xarm6"),
    "pick_iiwa": Golden("one_item", _PICK, robot="iiwa"),
    "kinematic": Golden("all_items", (*_PICK, "item_done: green_block_1"), backend="kinematic"),
    "insert": Golden("insert", ("item_done: red_dowel_40_1 inserted",)),
    "push": Golden("push", ("push: red_can_1: 1 strokes",)),
    "table_feed": Golden("table_feed", ("delivery", "item_done", "bin_exchanged")),
    "belt_feed": Golden("belt_feed", ("belt_runs", "belt_stops", "item_done"), backend="kinematic"),
    "slip": Golden(
        "one_item",
        ("fault: item_01 slips", "recovery: grasp.slipped", "episode: grasp.slipped: cured"), faults="slip",
    ),
    "jam": Golden(
        "one_item", ("frames_missed", "fault: the fingers jam", "regrasp", *_PICK), faults="jam",
        backend="kinematic",
    ),
    "resumed": Golden("all_items", ("checkpoint", "item_done: green_block_1"), interrupted=3.5),
    "noise": Golden("one_item", ("image: image from wrist", "servo", "item_done"), scene="noisy"),
    "walls": Golden("one_item", ("plan: RRTConnect", "item_done"), scene="walls", backend="kinematic"),
    "concave": Golden("one_item", ("pick: red_ring_1: held", "item_done: red_ring_1"), scene="concave"),
    "cell": Golden("one_item", _PICK, scene="two_items", in_cell=True),
    "pillar": Golden("watch", ("belief: obstacle_1", "item_done"), backend="kinematic"),
}  # fmt: skip


@dataclass(frozen=True)
class Computed:
    """Outcome of a golden run."""

    name: str
    digest: str
    cpu_seconds: float
    """CPU time of the run, s. The first run of a process imports some libraries, too."""


@dataclass(frozen=True)
class Record:
    """Content of `digests.json`."""

    libraries: Mapping[str, str]
    """Versions with which the digests were computed."""
    digests: Mapping[str, str]
    """Digest of each golden run by its name."""

    @classmethod
    def read(cls) -> Record:
        """Return the record of the file, an empty one when there is no file."""
        return cls(**json.loads(RECORD.read_text(encoding="utf-8"))) if RECORD.exists() else cls({}, {})

    def write(self) -> None:
        beside = RECORD.with_suffix(".part")
        beside.write_text(json.dumps(asdict(self), indent=2) + "\n", encoding="utf-8")
        beside.replace(RECORD)


class Entries(Observer):
    """Events and plans of a log, as texts."""

    def __init__(self) -> None:
        self._texts: list[str] = []

    def recorded(self, topic: Topic, at: int, data: bytes, in_digest: bool) -> None:
        if topic == topics.EVENTS:
            event = json.loads(data)
            self._texts.append(f"{event['kind']}: {event['message']}")
        elif topic == topics.PLAN:
            self._texts.append(f"plan: {json.loads(data)['planner']}")

    def missing(self, beginnings: Iterable[str]) -> list[str]:
        """Return the beginnings with which no text begins."""
        return [each for each in beginnings if not any(text.startswith(each) for text in self._texts)]


class GoldenError(Exception):
    """A golden run whose log lacks what the run is there for."""


def compute(name: str) -> Computed:
    """Execute a golden run in this process. Raises GoldenError when its log lacks an entry of `shows`."""
    golden = GOLDEN[name]
    began = time.process_time()
    entries = Entries()
    with TemporaryDirectory(prefix="golden-") as folder, _robot(golden, Path(folder)) as address:
        result = Session(golden.request(Path(folder), address), observers=[entries]).run()
        if golden.interrupted is not None:
            entries = Entries()
            request = ResumeRequest(result.folder, out=Path(folder), limit=DEFAULT_TIME_LIMIT)
            with Resumption(request) as resumption:
                result = resumption.session([entries]).run()
    missing = entries.missing(golden.shows)
    if missing:
        raise GoldenError(f"{name} ended with {result.status}, and its log has no {' and no '.join(missing)}")
    return Computed(name, result.digest, round(time.process_time() - began, 2))


@contextmanager
def _robot(golden: Golden, folder: Path) -> Generator[str]:
    """Serve the run's cell by a thread of this process; yield its address, which is empty without a cell."""
    if not golden.in_cell:
        yield ""
        return
    from picktree.drivers import protocol
    from picktree.simulation import cell_file
    from picktree.world.robot_model import load_robot
    from picktree.world.scene import load_scene
    from picktree_cell.cell_description import parse_cell
    from picktree_cell.cell_faults import CellFaults
    from picktree_cell.plant import Plant
    from picktree_cell.server import CellServer

    scene = load_scene(f"{golden.scene}.yaml", HERE)
    cell = parse_cell(cell_file(scene, load_robot(scene.robot, HERE), 0))
    server = CellServer(Plant(cell, CellFaults(), 0), 0)
    address = protocol.Address.parse(str(folder / "cell.sock"))

    class Channel(protocol.Channel):
        """Channel without shared memory: the tracker of one process would forget a segment twice."""

        def receive(self) -> protocol.Message:
            message = super().receive()
            hello = isinstance(message, protocol.Hello)
            return replace(message, wishes=protocol.Wish(0)) if hello else message

    def answer() -> None:
        connection, _ = listener.accept()
        with connection:
            server.serve(Channel(connection))

    with address.listen() as listener:
        thread = Thread(target=answer, daemon=True)
        thread.start()
        yield str(address)
        thread.join()


def libraries() -> dict[str, str]:
    """Return the versions of all libraries whose results are part of a digest."""
    packages = ("libpinocchio", "libcoal", "python-fcl", "trimesh", "toppra", "coacd", "mujoco")
    return {
        **arithmetic().versions,
        "Python": ".".join(platform.python_version_tuple()[:2]),
        **{package: version(package) for package in packages},
        "zlib": zlib.ZLIB_RUNTIME_VERSION,  # it packs the depth pictures
    }


def differing(recorded: Mapping[str, str], here: Mapping[str, str]) -> str:
    """Return each library with its two versions where they differ; empty when none does."""
    names = dict.fromkeys((*recorded, *here))
    return ", ".join(
        f"{name} {here.get(name, 'none')} instead of {recorded.get(name, 'none')}"
        for name in names
        if recorded.get(name) != here.get(name)
    )


def changes(recorded: Mapping[str, str], computed: Mapping[str, str]) -> list[str]:
    """Return a line for each run whose digest is not the recorded one, or that only one of them has."""
    names = dict.fromkeys((*recorded, *computed))
    return [
        f"{name}: {recorded.get(name, 'none')} is recorded, {computed.get(name, 'none')} is computed"
        for name in names
        if recorded.get(name) != computed.get(name)
    ]


def record() -> None:
    """Record the digests of all golden runs, and print what has changed."""
    before = Record.read()
    after = Record(libraries(), {name: compute(name).digest for name in GOLDEN})
    after.write()
    if others := differing(before.libraries, after.libraries):
        print(f"libraries: {others}")
    changed = changes(before.digests, after.digests)
    print(*changed, sep="\n", end="\n" if changed else "")
    print(f"{len(changed)} of {len(after.digests)} golden runs have changed")
    if changed:
        print("Say in CHANGELOG.md that digests are others than before, and why.")


def main() -> int:
    restart()
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(GOLDEN)}; all unless given")
    parser.add_argument("--write", action="store_true", help="record the digests of all runs")
    given = parser.parse_args()
    unknown = [name for name in given.names if name not in GOLDEN]
    if unknown:
        parser.error(f"there is no golden run {', '.join(unknown)}; known: {', '.join(GOLDEN)}")
    if given.write:
        record()
        return 0
    for name in given.names or GOLDEN:
        print(json.dumps(asdict(compute(name))), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
