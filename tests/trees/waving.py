"""A plug-in with one node, and missions that name it."""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from textwrap import dedent, indent

from picktree.trees import Mission
from picktree.trees.loading import NodeRegistry, parse_mission
from picktree.world import known_causes, restore_causes

WAVE = '''\
"""Waves."""
from picktree.trees import In, Out, port
from picktree.trees import Skill
from picktree.world import Cause, Failure, register_cause

TIRED = register_cause(Cause("wave.tired", "The arm is tired.", "wait"))

class Wave(Skill):
    """Wave the hand."""
    times: In[int] = port("how often", default=3)
    causes = (TIRED,)
    def run(self, world):
        yield

NODES = (Wave,)
'''


def mission(folder: Path, body: str = "{Main: Wave}", plugin: str = "wave.py") -> Mission:
    """A mission `m.yaml` in the folder, with those plug-ins."""
    text = f"picktree: 1\nkind: mission\nplugins: [{plugin}]\ntrees: {body}\n"
    return parse_mission(text, folder / "m.yaml", NodeRegistry())


def below(text: str) -> str:
    """Lines as they stand below a fault."""
    return "\n" + indent(dedent(text).strip("\n"), "    ")


@contextmanager
def forgotten() -> Generator[None]:
    """What plug-ins register and import inside is gone afterwards."""
    causes, modules = known_causes(), set(sys.modules)
    yield
    restore_causes(causes)
    for name in set(sys.modules) - modules:
        if name.startswith("picktree_plugin_"):
            del sys.modules[name]
