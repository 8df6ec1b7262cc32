"""A cell of MuJoCo in a process of its own, for tests."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from picktree.simulation import cell_file
from picktree.world.robot_model import load_robot
from picktree.world.scene import load_scene


@dataclass
class ServedCell:
    """Address of a served cell; after the block its score."""

    address: str
    score: dict[str, Any]
    process: subprocess.Popen[str]

    def kill(self) -> None:
        """Kill its process, as a power failure would: it leaves no score."""
        self.process.kill()


def write_cell(folder: Path, scene: str = "sort_small", seed: int = 0, robot: str = "panda") -> Path:
    """Write the cell file of a shipped scene."""
    description, arm = load_scene(scene, folder), load_robot(robot, folder)
    file = folder / "cell.json"
    file.write_text(json.dumps(cell_file(description, arm, seed)), encoding="utf-8")
    return file


@contextmanager
def served(cell: Path, *options: str, **faults: float) -> Iterator[ServedCell]:
    """Serve a cell for one client in the block."""
    folder = cell.parent
    (folder / "faults.json").write_text(json.dumps(faults), encoding="utf-8")
    address, score = folder / "cell.sock", folder / "score.json"
    command = [sys.executable, "-m", "picktree_cell", str(cell), "--at", str(address), "--clients", "1"]
    command += ["--faults", str(folder / "faults.json"), "--score", str(score), *options]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2]
    )
    found = ServedCell(str(address), {}, process)
    try:
        assert process.stdout is not None
        said = process.stdout.readline()
        assert said == f"ready at {address}\n", said + (process.stderr.read() if process.stderr else "")
        yield found
        process.communicate(timeout=60)
        if process.returncode < 0:  # killed
            return
        found.score = json.loads(score.read_text(encoding="utf-8"))
    finally:
        process.kill()
        process.communicate()
