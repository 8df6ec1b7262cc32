"""Missions whose first skill does to its process what a skill should not do; which, its seed says."""

from __future__ import annotations

from pathlib import Path

HEAD = """\
import builtins, ctypes, locale, os, random, signal, subprocess, sys, threading, time
from pathlib import Path

import numpy as np

from picktree.trees import Skill, Steps
from picktree.robot import World

HERE = Path({here!r})


class Trouble(Skill):
    \"\"\"What a skill should not do.\"\"\"

    def run(self, world: World) -> Steps:
        for _ in range(5):
            yield
        getattr(self, f"trouble_{{world.streams.seed}}", lambda: None)()
        if world.streams.seed == {endless}:
            while True:
                yield

"""
MISSION = """\
picktree: 1
kind: mission
name: trouble
scene: sort_small
goal: left >= 0
plugins: [trouble.py]
trees:
  Main: Trouble
"""
PICKING = """\
picktree: 1
kind: mission
name: trouble
scene: sort_small
goal: sorted >= 1 and misplaced == 0
plugins: [trouble.py]
trees:
  Main:
    Sequence:
      - Trouble
      - Observe: {camera: overhead, objects: "{items}"}
      - ForEach:
          in: "{items}"
          out: "{item}"
          most: 1
          do:
            - Grasp: {object: "{item}"}
            - Place: {object: "{item}", into: "{item.destination}"}
"""


def troubled(folder: Path, doings: dict[int, str], *, endless: int = -1, picking: bool = False) -> Path:
    """A mission that does that for these seeds, where `HERE` is `folder`; then it picks one item, or none."""
    methods = [
        f"    def trouble_{seed}(self) -> None:\n"
        + "".join(f"        {line}\n" for line in doing.splitlines())
        for seed, doing in doings.items()
    ]
    head = HEAD.format(here=str(folder), endless=endless)
    (folder / "trouble.py").write_text(head + "\n".join(methods) + "\n\nNODES = (Trouble,)\n")
    mission = folder / "mission.yaml"
    mission.write_text(PICKING if picking else MISSION)
    return mission
