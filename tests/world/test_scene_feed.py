"""Feeds, belts and the exchange of bins in scene files: what is read, and every fault with its place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from picktree.files import FileError
from picktree.files.yaml import read_document
from picktree.world import Box
from picktree.world.scene import AtIntervals, AtTimes, Belt, Delivery, WhenClear, parse_scene
from picktree.world.scene.description import Exchange
from picktree.world.scene.scene_loading import check_scene

SCENE = """\
picktree: 1
kind: scene
robot: panda
fixtures:
  table: {box: [1.2, 1.6, 0.04], at: [0.5, 0, -0.02]}
  belt: {belt: [1.0, 0.2, 0.05], at: [0.55, 0, 0], yaw: 90 deg, speed: 80 mm/s, eye: 0.3}
  bin_a: {bin: [0.25, 0.20, 0.10], wall: 5 mm, at: [0.4, 0.5, 0]}
catalogue:
  block: {box: [4 cm, 4 cm, 4 cm], mass: 0.1, friction: 0.6}
  can: {cylinder: {radius: 2 cm, height: 8 cm}, mass: 120 g, friction: 0.5}
feed:
  - {of: {block: 2}, colours: [red], area: {min: [0.3, -0.2], max: [0.4, 0.2]}, when: {every: 45 s}}
  - {of: {block: 2, can: 1}, colours: [red, blue], belt: belt, spacing: 20 cm, total: 60}
exchange: {takes: 6 s}
"""
HERE = Path("scene.yaml")


def faults(text: str) -> str:
    with pytest.raises(FileError) as caught:
        parse_scene(text, HERE)
    return str(caught.value)


def test_a_feed_is_read() -> None:
    scene = parse_scene(SCENE, HERE)
    assert scene.belts == (Belt(scene.fixtures[1].id, 0.08, 0.3),)
    assert scene.exchange == Exchange(6.0)
    table, belt = scene.deliveries
    assert table == Delivery({"block": 2}, ("red",), ((0.3, -0.2), (0.4, 0.2)), when=AtIntervals(45.0))
    assert (belt.belt, belt.when, belt.total, belt.spacing) == ("belt", WhenClear(), 60, 0.2)
    assert belt.load.counts == {"block": 2, "can": 1}


def test_a_belt_is_a_fixture_that_stands_on_its_place() -> None:
    belt = parse_scene(SCENE, HERE).fixture("belt")
    assert (belt.shape, belt.pose.position) == (Box((1.0, 0.2, 0.05)), (0.55, 0.0, 0.025))
    assert belt.pose.apply([[0.3, 0.0, 0.025]])[0] == pytest.approx((0.55, 0.3, 0.05))  # type: ignore[arg-type]


def test_a_scene_without_a_feed_has_none() -> None:
    scene = parse_scene(SCENE[: SCENE.index("feed:")], HERE)
    assert (scene.deliveries, scene.exchange) == ((), None)


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("clear", WhenClear()),
        ("{every: 1 min}", AtIntervals(60.0)),
        ("{at: [10 s, 1 min]}", AtTimes((10.0, 60.0))),
    ],
)
def test_when_a_load_comes(written: str, read: object) -> None:
    table, _ = parse_scene(SCENE.replace("{every: 45 s}", written), HERE).deliveries
    assert table.when == read
    assert table.total == (4 if isinstance(read, AtTimes) else None)


REPLACED = {  # by the text that is replaced and the one in its place
    "speed: 80 mm/s": {
        "speed: 80 mm": "6:72: fixtures.belt.speed: '80 mm' is a length, not a speed (as 100 mm/s)",
        "speed: 1 m/s": "6:72: fixtures.belt.speed: 1 m/s is more than 0.5 m/s",
    },
    ", speed: 80 mm/s": {
        "": "6:3: fixtures.belt: 'speed' is missing (how fast the belt runs, as 80 mm/s)",
    },
    ", eye: 0.3}": {
        "}": (
            "6:3: fixtures.belt: 'eye' is missing "
            "(where the light barrier crosses the belt, from its middle, as 0.4 m)"
        ),
    },
    "eye: 0.3": {
        "eye: 60 cm": (
            "6:86: fixtures.belt.eye: 60 cm from its middle is not on the belt "
            "(it reaches from -0.5 m to 0.5 m)"
        ),
        "eye: -0.45": (
            "6:86: fixtures.belt.eye: items are set down in the light barrier, or beyond it "
            "(at -0.42 m or more the items reach the barrier)"
        ),
    },
    "yaw: 90 deg": {"rpy: [0, 9 deg, 0]": "6:52: fixtures.belt.rpy: a belt lies level: give its 'yaw'"},
    "wall: 5 mm": {"wall: 5 mm, eye: 0": "7:48: fixtures.bin_a.eye: only a belt has 'eye'"},
    "{box: [1.2, 1.6, 0.04], ": {
        "{box: 3, ": "5:16: fixtures.table.box: a list is wanted, not 3",
        "{": "5:3: fixtures.table: 'box', 'bin', 'tote', 'belt' or 'marker' is missing",
    },
    "exchange:": {
        "limits: {workspace: {min: [0, -0.2, 0], max: [0.8, 0.2, 1]}}\nexchange:": (
            "6:86: fixtures.belt.eye: the belt stops at x 0.55 m, y 0.30 m, outside of the workspace "
            "(which is x 0 … 0.8 m, y -0.2 … 0.2 m)"
        ),
        "  - {of: {can: 1}, colours: [red], belt: belt}\nexchange:": (
            "14:42: feed[2].belt: feed[1] comes on the belt 'belt' already "
            "(a belt has one entry: use a mixture)"
        ),
    },
    "{block: 2}": {
        "{blok: 2}": "12:11: feed[0].of.blok: the catalogue has no 'blok' (did you mean 'block'?)",
        "{block: 40}": (
            "12:45: feed[0].area: 40 items with gaps of 25 mm do not fit: they need 0.169 m², and the area "
            "with its rim has 0.087 m² (enlarge the area, or ask for fewer items or smaller gaps)"
        ),
    },
    "max: [0.4, 0.2]": {
        "max: [0.4, 0.9]": (
            "12:44: feed[0].area: the area is not over a level fixture (items need a table below them)"
        ),
    },
    "when: {every: 45 s}": {
        "when: often": (
            "12:87: feed[0].when: 'often' is no time for a load "
            "(it is clear, {every: 45 s} or {at: [10 s, 60 s]})"
        ),
        "spacing: 3 cm": "12:81: feed[0].spacing: only items on a belt have a spacing",
    },
    "{every: 45 s}": {
        "{every: 0 s}": "12:95: feed[0].when.every: 0 s is less than 1 s",
        "{}": "12:81: feed[0].when: 'every' or 'at' is missing",
        "{every: 45 s, at: [1]}": (
            "12:81: feed[0].when: 'every' and 'at' exclude each other (give one of them)"
        ),
        "{at: [2 s, 9 s, 3 s]}": (
            "12:103: feed[0].when.at[2]: 3 s does not come after the load before it (times ascend)"
        ),
        "{at: [2 s, 9 s]}, total: 5": (
            "12:112: feed[0].total: 5 items do not fit into 2 loads of 2 "
            "(give more times, or leave the total out)"
        ),
    },
    "belt: belt": {
        "belt: [1]": "13:58: feed[1].belt: a text is wanted, not a list",
        "belt: bolt": "13:58: feed[1].belt: there is no belt 'bolt' (did you mean 'belt'?)",
        "belt: belt, area: {min: [0, 0], max: [1, 1]}": (
            "13:5: feed[1]: 'area' and 'belt' exclude each other (give one of them)"
        ),
        "belt: belt, when: {every: 3 s}": (
            "13:64: feed[1].when: items on a belt come one by one (a belt runs whenever the robot is ready)"
        ),
        "belt: belt, gap: 3 cm": ("13:64: feed[1].gap: items on a belt come one by one (give its 'spacing')"),
    },
    "belt: belt, ": {"": "13:5: feed[1]: 'area', 'belt' or 'into' is missing"},
    "spacing: 20 cm": {
        "spacing: 8 cm": (
            "13:73: feed[1].spacing: items that are 57 mm across would touch on the belt "
            "(give a spacing of at least 89 mm)"
        ),
    },
    "[1.0, 0.2, 0.05]": {
        "[1.0, 0.2]": "6:16: fixtures.belt.belt: 3 values are wanted, not 2",
        "[1.0, 0.05, 0.05]": ("13:11: feed[1].of.block: a block is 57 mm across, and the belt is 50 mm wide"),
    },
    "{takes: 6 s}": {"{takes: 0 s}": "14:19: exchange.takes: 0 s is not positive"},
}


TOTE = """\
picktree: 1
kind: scene
base: tote
feed:
  - {of: {assortment: 12}, colours: [red, blue], into: tote, total: 120}
exchange: {takes: 6 s}
"""
REPLACED_OF_TOTE = {
    "into: tote": {
        "into: tot": "5:56: feed[0].into: there is no tote 'tot' (did you mean 'tote'?)",
        "area: {min: [0.4, -0.1], max: [0.5, 0.1]}": (
            "5:11: feed[0].of.assortment: the catalogue has no 'assortment'"
        ),
    },
    "total: 120": {
        "when: {every: 45 s}": (
            "5:62: feed[0].when: items come with their tote "
            "(a tote comes full when it is exchanged, and its items lie anywhere)"
        ),
    },
    "exchange:": {
        "  - {of: {assortment: 3}, colours: [red], into: tote}\nexchange:": (
            "6:49: feed[1].into: feed[0] comes into the tote 'tote' already "
            "(a full tote has one entry: use a mixture)"
        ),
    },
}


@pytest.mark.parametrize(
    ("scene", "old", "new", "message"),
    [
        (scene, old, new, message)
        for scene, replaced in ((SCENE, REPLACED), (TOTE, REPLACED_OF_TOTE))
        for old, table in replaced.items()
        for new, message in table.items()
    ],
)
def test_a_fault_is_named(scene: str, old: str, new: str, message: str) -> None:
    assert old in scene
    assert faults(scene.replace(old, new, 1)).removeprefix("scene.yaml:").startswith(message)


def warnings(text: str) -> list[str]:
    found = check_scene(read_document(HERE, "scene", text))
    assert found.value is not None
    return [str(fault) for fault in found.faults]


def test_a_feed_of_totes_is_read() -> None:
    scene = parse_scene(TOTE, HERE)
    (delivery,), (spawn,) = scene.deliveries, scene.spawn
    assert (delivery.load.into, delivery.load.drop, delivery.total) == ("tote", "heap", 120)
    assert delivery.area == spawn.area
    assert replace(scene, spawn=()).heaped, "what comes in totes needs physics, too"


def test_a_tote_that_nobody_exchanges_is_told() -> None:
    assert warnings(TOTE) == []
    assert warnings(TOTE.replace("exchange: {takes: 6 s}\n", "")) == [
        "scene.yaml:5:56: feed[0].into: nobody exchanges the tote 'tote', so no full one comes "
        "(add 'exchange: {takes: 6 s}')"
    ]


def test_a_belt_to_which_nothing_comes_is_told() -> None:
    without = "".join(line for line in SCENE.splitlines(keepends=True) if "belt: belt" not in line)
    assert warnings(SCENE) == []
    assert warnings(without) == [
        "scene.yaml:6:3: fixtures.belt: nothing comes on the belt 'belt' "
        "(add an entry to 'feed' with 'belt: belt')"
    ]


def test_an_exchange_without_a_bin_is_told() -> None:
    without = "".join(line for line in SCENE.splitlines(keepends=True) if "bin_a" not in line)
    assert warnings(without) == [
        "scene.yaml:13:1: exchange: there is no bin that could be exchanged (a fixture with 'bin')"
    ]
