"""A mission made of several files: it runs, and its log holds all that is needed to read it again."""

from __future__ import annotations

from pathlib import Path

from picktree.logs import RunLog
from picktree.session import RunRequest, Session
from picktree.trees import RecordedFiles
from picktree.trees.loading import parse_mission

from .test_session import ONE_ITEM

MISSION = """
picktree: 1
kind: mission
scene: one.yaml
include: [parts/look.yaml, library/sorting]
trees:
  Main:
    Sequence:
      - Look: {items: "{items}"}
      - PickAndPlaceAll: {items: "{items}"}
"""
LOOK = """
picktree: 1
kind: mission
library: true
trees:
  Look:
    ports: {items: {type: list of object, direction: out}}
    Observe: {objects: "{items}"}
"""


def test_a_log_serves_the_files_that_its_mission_includes(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "look.yaml").write_text(LOOK)
    (tmp_path / "sort.yaml").write_text(MISSION)
    (tmp_path / "one.yaml").write_text(ONE_ITEM)
    session = Session(RunRequest(tmp_path / "sort.yaml", out=tmp_path / "runs", backend="kinematic"))
    result = session.run()
    assert (result.status, result.items.sorted, result.items.left) == ("success", 1, 0)

    with RunLog(result.log) as log:
        prefix = "include/"
        names = [name.removeprefix(prefix) for name in log.attachments if name.startswith(prefix)]
        assert names == ["parts/look.yaml", "library/sorting", "library/recovery"]
        texts = {name: log.attachment(prefix + name).decode() for name in names}
        text = log.attachment("mission.yaml").decode()
    elsewhere = Path("/nowhere/sort.yaml")
    again = parse_mission(text, elsewhere, None, RecordedFiles(texts, elsewhere.parent))
    assert list(again.trees) == list(session.execution.mission.trees)
    assert texts["parts/look.yaml"] == LOOK


RECOVERY = """
picktree: 1
kind: mission
scene: sort_small
goal: misplaced == 0
include: [library/recovery]
trees:
  Main:
    Sequence:
      - LookAgain
      - RetreatAndLook: {pose: observe}
      - WaitAndLook: {pause: 1 s}
      - LetGoAndRetreat
"""


def test_the_trees_of_recovery_do_what_they_say(tmp_path: Path) -> None:
    (tmp_path / "cure.yaml").write_text(RECOVERY)
    result = Session(RunRequest(tmp_path / "cure.yaml", out=tmp_path / "runs", backend="kinematic")).run()
    assert result.status == "success"
    with RunLog(result.log) as log:
        started = [
            node.path for tick in log.ticks() for node in tick.record.nodes if node.status == "RUNNING"
        ]
    assert list(dict.fromkeys(path for path in started if path.count("/") == 3)) == [
        "Main/Sequence/LookAgain/Observe",
        "Main/Sequence/RetreatAndLook/Sequence",
        "Main/Sequence/WaitAndLook/Delay",
        "Main/Sequence/LetGoAndRetreat/SafeRetreat",
    ]
