"""What can be wrong with a plug-in: each is one fault, with the plug-in's own traceback where it has one."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from textwrap import dedent

import pytest

from picktree.files import FileError
from picktree.world import known_causes

from .waving import WAVE, below, forgotten, mission


@pytest.fixture(autouse=True)
def alone() -> Iterator[None]:
    with forgotten():
        yield


def fault(folder: Path, source: str | bytes, plugin: str = "wave.py") -> tuple[str, str]:
    """Code and whole text of the one fault of a mission with that plug-in; `{folder}` is where it lies."""
    data = source if isinstance(source, bytes) else dedent(source).encode()
    (folder / plugin).write_bytes(data)
    with pytest.raises(FileError) as caught:
        mission(folder, "{Main: AlwaysSuccess}", plugin)
    (found,) = caught.value.faults
    assert str(caught.value) == str(found)
    assert str(found).startswith(f"{folder}/m.yaml:3:11: plugins[0]: ")
    return found.code, str(found).removeprefix(f"{folder}/m.yaml:3:11: plugins[0]: ").replace(
        str(folder), "{folder}"
    )


BROKEN = [  # source, first line after the plug-in's name, traceback
    ("import math\n\ndef half(n):\n    return 1 / n\n\nhalf(0)\n",
     "ZeroDivisionError: division by zero",
     """
     Traceback (most recent call last):
       File "{folder}/wave.py", line 6, in <module>
         half(0)
       File "{folder}/wave.py", line 4, in half
         return 1 / n
                ~~^~~
     ZeroDivisionError: division by zero
     """),
    ("class Wave(\n",
     "SyntaxError: '(' was never closed (wave.py, line 1)",
     """
       File "{folder}/wave.py", line 1
         class Wave(
                   ^
     SyntaxError: '(' was never closed
     """),
    ("try:\n    1/0\nexcept ArithmeticError as error:\n    raise OSError('no\\nsensor') from error\n",
     "OSError: no",
     """
     Traceback (most recent call last):
       File "{folder}/wave.py", line 2, in <module>
         1/0
         ~^~
     ZeroDivisionError: division by zero

     The above exception was the direct cause of the following exception:

     Traceback (most recent call last):
       File "{folder}/wave.py", line 4, in <module>
         raise OSError('no\\nsensor') from error
     OSError: no
     sensor
     """),
]  # fmt: skip


@pytest.mark.parametrize(("source", "said", "traceback"), BROKEN)
def test_what_a_plug_in_raises_is_shown_with_its_own_traceback(
    source: str, said: str, traceback: str, tmp_path: Path
) -> None:
    assert fault(tmp_path, source) == (
        "P252", f"the plug-in 'wave.py' cannot be imported: {said}{below(traceback)}"
    )  # fmt: skip


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("import no_such_module\n", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("import sys\nsys.exit(3)\n", "SystemExit: 3"),
        ("raise KeyboardInterrupt\n", "KeyboardInterrupt"),
        ("def again():\n    again()\nagain()\n", "RecursionError: maximum recursion depth exceeded"),
    ],
)
def test_whatever_a_plug_in_raises_is_a_fault_of_it(source: str, said: str, tmp_path: Path) -> None:
    code, text = fault(tmp_path, source)
    first, *others = text.splitlines()
    assert (code, first) == ("P252", f"the plug-in 'wave.py' cannot be imported: {said}")
    assert others[-1].strip() == said
    assert all("{folder}/wave.py" in line for line in others if "File " in line), "no line of ours"


NO_CLASS = "is not a node class (a class derived from Skill, ConditionNode or Control)"
NO_CAUSES = "node Wave: 'causes' is a tuple of causes (as 'causes = (grasp.MISSED, planning.ANY)')"
AT_THE_CLASS = below(
    """
    Traceback (most recent call last):
      File "{folder}/wave.py", line 8, in <module>
        class Wave(Skill):
    """
)
TAKEN = "(give the class a 'node_id' of its own)"
FAULTS = [  # source, code, text after the plug-in's name
    (WAVE.replace("NODES = (Wave,)", ""),
     "P253", "has no NODES, a tuple of node classes (write 'NODES = (Wave,)')"),
    ("", "P253", "has no NODES, a tuple of node classes (as 'NODES = (Wave,)')"),
    (WAVE.replace("(Wave,)", "(Wave)"),
     "P253", "has something else as NODES, a tuple of node classes (write 'NODES = (Wave,)')"),
    ("NODES = ()", "P253", "offers no node: its NODES is empty"),
    ("NODES = (3,)", "P253", f"an int in NODES {NO_CLASS}"),
    ("from picktree.trees import Skill\nNODES = (Skill,)", "P253", f"Skill in NODES {NO_CLASS}"),
    (WAVE.replace('    """Wave the hand."""\n', ""),
     "P254", f"node Wave: the class needs a docstring, for the reference of nodes{AT_THE_CLASS}"),
    (WAVE.replace("In[int]", "In[dict]"),
     "P254", f"port Wave.times: <class 'dict'> cannot be the type of a port{AT_THE_CLASS}"),
    (WAVE.replace("def run", "def go"),
     "P254", "node Wave: it has no 'run' (as 'def run(self, world): ...', with a 'yield' in it)"),
    (WAVE.replace("trees import Skill", "trees import Node as Skill"),
     "P254", "node Wave: it has no 'on_tick' (derive it from Skill and write 'run', or write 'on_tick')"),
    (WAVE.replace("def run", "def __init__(self): ...\n    def run"),
     "P254", "node Wave: it has an '__init__' of its own (leave it out; what a node begins with is set in "
     "'on_start')"),
    (WAVE.replace("(TIRED,)", "('wave.tired',)"), "P254", NO_CAUSES),
    (WAVE.replace("(TIRED,)", "TIRED"), "P254", NO_CAUSES),
    (WAVE.replace("causes = (TIRED,)", "uses = ('arm',)"),
     "P254", "node Wave: 'uses' is a tuple of resources (as 'uses = (ARM, GRIPPER)')"),
    (WAVE.replace("causes = (TIRED,)", "kind = 'skill'"),
     "P254", "node Wave: its kind 'skill' is unknown "
     "(one of action, condition, control, decorator, subtree)"),
    (WAVE.replace("causes = (TIRED,)", "hand_after = 'holding'"),
     "P254", "node Wave: its hand_after 'holding' is unknown (one of unchanged, full, empty, kept)"),
    (WAVE.replace('"wave.tired"', '"grasp.tired"'),
     "P255", "cause 'grasp.tired': the prefix 'grasp' belongs to picktree; use your own"
     + below(
         """
         Traceback (most recent call last):
           File "{folder}/wave.py", line 6, in <module>
             TIRED = register_cause(Cause("grasp.tired", "The arm is tired.", "wait"))
                     ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
         """
     )),
    (WAVE.replace("register_cause(Cause(", "(Cause("),
     "P255", "node Wave: the cause 'wave.tired' is not registered (write 'register_cause(Cause(...))')"),
    (WAVE.replace("register_cause(Cause(", "(Cause(").replace("wave.tired", "grasp.tired"),
     "P255", "node Wave: the cause 'grasp.tired' is not registered (the prefix 'grasp' belongs to picktree; "
     "register the cause under a prefix of your own)"),
    (WAVE.replace("(TIRED,)", "(TIRED, Family('waves'))").replace("Cause,", "Cause, Family,"),
     "P255", "node Wave: no cause of the family 'waves.*' is registered"),
    (WAVE.replace("Wave(", "Grasp(").replace("(Wave", "(Grasp"),
     "P256", f"the node 'Grasp' is already offered by picktree.skills {TAKEN}"),
    (WAVE.replace("NODES = (Wave,)", "First = Wave\n")
     + WAVE.split("wait\"))\n")[1].replace("(Wave,)", "(First, Wave)"),
     "P256", f"the node 'Wave' is already offered by wave.py {TAKEN}"),
]  # fmt: skip


@pytest.mark.parametrize(("source", "code", "text"), FAULTS)
def test_what_is_wrong_with_a_plug_in_is_one_clear_fault(
    tmp_path: Path, source: str, code: str, text: str
) -> None:
    before = set(sys.modules), known_causes()
    found, shown = fault(tmp_path, source)
    assert (found, shown.removeprefix("the plug-in 'wave.py'").lstrip(": ")) == (code, text)
    if code != "P256":
        assert not [m for m in set(sys.modules) - before[0] if m.startswith("picktree_plugin_")]
        assert known_causes() == before[1]


def test_the_traceback_of_an_endless_recursion_is_cut(tmp_path: Path) -> None:
    _, text = fault(tmp_path, "def a(): b()\ndef b(): a()\na()\n")
    assert "lines are left out" in text
    assert len(text.splitlines()) == 42
    assert text.splitlines()[-1].strip().startswith("RecursionError: ")


def test_a_text_with_a_byte_0_is_a_fault_of_the_plug_in(tmp_path: Path) -> None:
    code, text = fault(tmp_path, b"a = 1\0\n")
    assert code == "P252"
    assert text.splitlines()[0].endswith("Error: source code string cannot contain null bytes")


def test_a_cause_that_two_plug_ins_register_differently(tmp_path: Path) -> None:
    (tmp_path / "wave.py").write_text(WAVE)
    (tmp_path / "wink.py").write_text(WAVE.replace("Wave", "Wink").replace("The arm is", "The eye is"))
    with pytest.raises(FileError) as caught:
        mission(tmp_path, "{Main: AlwaysSuccess}", "wave.py, wink.py")
    assert str(caught.value).splitlines()[0] == (
        f"{tmp_path}/m.yaml:3:20: plugins[1]: the plug-in 'wink.py': cause 'wave.tired': it is registered "
        "already with another meaning ('The arm is tired.'); use a prefix of your own"
    )
    (tmp_path / "wink.py").write_text(WAVE.replace("Wave", "Wink"))
    assert [s.name for s in mission(tmp_path, "{Main: Wink}", "wave.py, wink.py").sources] == [
        "wave.py",
        "wink.py",
    ]


OUTSIDE = "lies outside of the mission's folder (copy it there, or install it and name its module)"


@pytest.mark.parametrize(
    ("plugin", "code", "text"),
    [
        ("nowhere.py", "P257", "there is no plug-in 'nowhere.py' beside the mission"),
        ("folder.py", "P257", "there is no plug-in 'folder.py' beside the mission"),
        ('"a\\0.py"', "P257", "'a\\x00.py' cannot be the name of a file"),
        ("a" * 300 + ".py", "P257", f"there is no plug-in '{'a' * 300}.py' beside the mission"),
        ("json.wavve", "P257", "there is no plug-in 'json.wavve': no module of that name is installed"),
        ("greet", "P257", "there is no plug-in 'greet': no module of that name is installed "
         "(for the file beside the mission write 'greet.py')"),
        ("wave", "P253", "the plug-in 'wave' has no NODES, a tuple of node classes "  # a module of Python
         "(for the file beside the mission write 'wave.py')"),
        (".wave", "P257", "'.wave' cannot be the name of a module "
         "(as 'my_cell.skills', or 'wave.py' for a file beside the mission)"),
        ("../wave.py", "P251", f"the plug-in '../wave.py' {OUTSIDE}"),
        ("/tmp/wave.py", "P251", f"the plug-in '/tmp/wave.py' {OUTSIDE}"),
        ("link.py", "P251", f"the plug-in 'link.py' {OUTSIDE}"),
        ("json", "P253", "the plug-in 'json' has no NODES, a tuple of node classes (as 'NODES = (Wave,)')"),
    ],
)  # fmt: skip
def test_a_plug_in_that_is_not_there(tmp_path: Path, plugin: str, code: str, text: str) -> None:
    home = tmp_path / "home"
    (home / "folder.py").mkdir(parents=True)
    for place in (home, tmp_path):
        (place / "wave.py").write_text(WAVE)
    (home / "greet.py").write_text(WAVE)
    (home / "link.py").symlink_to(tmp_path / "wave.py")
    with pytest.raises(FileError) as caught:
        mission(home, "{Main: AlwaysSuccess}", plugin)
    (found,) = caught.value.faults
    assert (found.code, str(found)) == (code, f"{home}/m.yaml:3:11: plugins[0]: {text}")


FOLLOWING = """{Main: {Recover: {
  do: {Sequence: [{Wave: {times: 2}}, {Script: {code: "a := done"}}, Waev, Grsap]},
  when: {wave.tired: Wave, wave.*: Wave, wave.tierd: AlwaysSuccess, grasp.mised: AlwaysSuccess}}}}"""


def said(folder: Path, plugin: str) -> list[tuple[str, str]]:
    with pytest.raises(FileError) as caught:
        mission(folder, FOLLOWING, plugin)
    return [(each.code, each.message.partition(" (")[0]) for each in caught.value.faults]


def test_what_follows_from_a_plug_in_that_cannot_be_loaded_is_not_told_again(tmp_path: Path) -> None:
    (tmp_path / "wave.py").write_text(f"import no_such_module\n{WAVE}")
    first, *others = said(tmp_path, "wave.py")
    assert first[0] == "P252"
    assert others == [
        ("P207", "unknown node 'Waev'"),
        ("P207", "unknown node 'Grsap'"),
        ("P233", "no cause is called 'wave.tierd'"),
        ("P233", "no cause is called 'grasp.mised'"),
    ]


def test_of_a_plug_in_without_a_text_any_name_may_be(tmp_path: Path) -> None:
    assert said(tmp_path, "wave.py") == [
        ("P257", "there is no plug-in 'wave.py' beside the mission"),
        ("P207", "unknown node 'Grsap'"),
        ("P233", "no cause is called 'grasp.mised'"),
    ]
