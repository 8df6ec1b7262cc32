"""What is set from outside for one run: parameters of the mission, and ports of nodes by a pattern."""

from pathlib import Path

import pytest

from picktree.files import PicktreeError
from picktree.session import RunRequest, Session
from picktree.trees import read_settings
from picktree.trees.loading import load_mission
from picktree.trees.references import Constant

EXAMPLES = Path(__file__).parents[2] / "examples"
SORT_ONE = "Main/Repeat/Sequence/ForEach/SortOne"


def test_a_pattern_sets_the_port_of_every_node_that_fits_it() -> None:
    mission = load_mission(EXAMPLES / "sort_by_colour.yaml")
    settings = read_settings(
        mission, {"rounds": "2", "SortOne/Grasp.force": "15 N", "SafeRetreat.hand": "open"}
    )
    assert settings.parameters == {"rounds": Constant(2, "2")}
    grasp = f"{SORT_ONE}/Recover/Sequence/Grasp"
    assert settings.overrides[grasp] == {"force": Constant(15.0, "15 N")}
    retreats = [path for path, ports in settings.overrides.items() if "hand" in ports]
    assert len(retreats) > 3
    assert all(path.rpartition("/")[2].startswith("SafeRetreat") for path in retreats)


def test_a_run_with_an_override_has_it_in_its_tree(tmp_path: Path) -> None:
    request = RunRequest(
        EXAMPLES / "one_pick.yaml", backend="kinematic", out=tmp_path, parameters={"Grasp.force": "12"}
    )
    grasp = next(node for node in Session(request).execution.tree.nodes if node.wiring.id == "Grasp")
    assert grasp.save_state()["ports"]["force"] == "12"  # type: ignore[index, call-overload]


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("Grab.force", "15", "Grab.force: no node of the mission fits 'Grab' (did you mean 'Grasp'?)"),
        ("Grasp.forse", "15", "Grasp.forse: Grasp has no input 'forse' (did you mean 'force'?)"),
        ("Grasp.force", "2 s", "Grasp.force: port 'force' of Grasp: '2 s' is a time, not a force (as 20 N)"),
        (
            "Observe.objects",
            "x",
            "Observe.objects: Observe has no input 'objects' (known: camera, expect, fresh)",
        ),
        ("Recover.attempts", "0", "Recover.attempts: port 'attempts' of Recover: 0 is less than 1"),
    ],
)  # fmt: skip
def test_an_override_that_does_not_fit_is_refused(name: str, value: str, message: str) -> None:
    mission = load_mission(EXAMPLES / "sort_by_colour.yaml")
    with pytest.raises(PicktreeError) as refused:
        read_settings(mission, {name: value})
    assert str(refused.value) == message
