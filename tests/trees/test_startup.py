"""Reading and checking a mission needs no planner, no collision checker of the arm and no simulator."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

HEAVY = ("pinocchio", "coal", "ompl", "pybullet", "toppra", "cv2", "mcap")
EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "sort_by_colour.yaml"
PROGRAM = f"""
import sys
from pathlib import Path
from picktree.authoring.check import check_mission
from picktree.files.yaml.document import read_document
checked = check_mission(read_document(Path({str(EXAMPLE)!r}), "mission"))
assert checked.mission is not None and "Grasp" in str(checked.mission.trees)
print([name for name in {HEAVY!r} if name in sys.modules])
"""


def test_checking_a_mission_loads_nothing_heavy() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
