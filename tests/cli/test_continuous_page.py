"""docs/continuous.md: its commands are taken, it names all that there is for a feed."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from picktree.apps.cli.run import parse_parameters
from picktree.trees import parameter_value
from picktree.trees.loading import load_mission
from picktree.world import feed

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "continuous.md").read_text("utf-8")
COMMANDS = [shlex.split(line, comments=True) for line in re.findall(r"^picktree .*", PAGE, re.MULTILINE)]


def test_its_commands_name_missions_and_their_parameters() -> None:
    assert len(COMMANDS) > 3
    for command in COMMANDS:
        mission = load_mission(ROOT / command[2])
        ports = {port.key: port for port in mission.parameters}
        given = [command[k + 1] for k, word in enumerate(command) if word == "--set"]
        for name, text in parse_parameters(given).items():
            parameter_value(text, ports[name])


@pytest.mark.parametrize(
    "name", [feed.LATE.name, feed.NO_EXCHANGE.name, feed.OBSTRUCTED.name, "feed_exhausted", "items_done"]
)
def test_it_names_causes_and_facts(name: str) -> None:
    assert f"`{name}`" in PAGE


def test_it_names_the_trees_of_the_library(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(
        "picktree: 1\nkind: mission\ninclude: [library/feeding]\ntrees: {Main: AlwaysSuccess}\n"
    )
    (tmp_path / "r.yaml").write_text(
        "picktree: 1\nkind: mission\ninclude: [library/recovery]\ntrees: {Main: AlwaysSuccess}\n"
    )
    trees = set(load_mission(tmp_path / "m.yaml").trees) - set(load_mission(tmp_path / "r.yaml").trees)
    assert {name for name in trees if f"`{name}`" not in PAGE} == set()


def test_what_its_figures_say_of_the_example() -> None:
    mission = (ROOT / "examples" / "continuous_sort.yaml").read_text("utf-8")
    library = (ROOT / "trees" / "library" / "feeding.yaml").read_text("utf-8")
    assert "fill: {type: float, default: 0.6" in mission
    assert "longest: {type: float, unit: s, default: 10 min" in library
    assert "attempts: {type: int, default: 4" in library
    assert "rounds: {type: int, default: 2" in library
