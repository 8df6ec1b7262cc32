"""URDFs with faults: each is refused with what is there, by `robot new` and by a robot file that names it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from picktree.apps.cli import answer
from picktree.apps.cli.file_schemas import CHECKS
from picktree.files.file_checks import check_files
from picktree.robot.planning import robot_geometry
from picktree.world.robot_model import RobotModel, UrdfError, load_robot
from picktree.world.robot_model.urdf_parser import parsed_urdf

from .arms import ROBOT, joint, link, mini

J2, J4 = joint("j2"), joint("j4")
L3 = link("l3")
LOWER = '<limit lower="-2.0"'

FAULTS: dict[str, tuple[tuple[tuple[str, str], ...], tuple[str, ...]]] = {
    "axis of no direction": (
        ((J4, J4.replace('axis xyz="0 0 1"', 'axis xyz="0 0 0"')),),
        ("joint 'j4': <axis xyz=\"0 0 0\"> has no direction; write that of its motion, as xyz=\"0 0 1\"",),
    ),
    "axis of two numbers": (
        ((J4, J4.replace('axis xyz="0 0 1"', 'axis xyz="0 1"')),),
        ('joint \'j4\': <axis xyz="0 1"> has 2 numbers, not three; write it as xyz="0 0 1"',),
    ),
    "limits in degrees": (
        ((J2, J2.replace('lower="-2.0" upper="2.0"', 'lower="-115" upper="115"')),),
        ("joint 'j2': limits of -115 … 115 rad: are they degrees? Write -2.007 … 2.007",),
    ),
    "swapped limits": (
        ((J2, J2.replace('lower="-2.0" upper="2.0"', 'lower="2.0" upper="-2.0"')),),
        ("joint 'j2': the lower limit, 2, is above the upper, -2: are they swapped?",),
    ),
    "limits with commas": (
        ((LOWER, '<limit lower="-2,0"'),),
        ("joint 'j2': <limit lower=\"-2,0\"> has a decimal comma; write -2",),
    ),
    "limit with a unit": (
        ((LOWER, '<limit lower="-115deg"'),),
        ("joint 'j2': <limit lower=\"-115deg\"> has a unit; write -2.007, in rad",),
    ),
    "limit that is NaN": (
        ((LOWER, '<limit lower="nan"'),),
        ("joint 'j2': <limit lower=\"nan\"> is no finite number; write one, in rad",),
    ),
    "limit that is a word": (
        ((LOWER, '<limit lower="low"'),),
        ("joint 'j2': <limit lower=\"low\"> is no number; write one, in rad",),
    ),
    "limit of a number in Python's spelling": (
        ((LOWER, '<limit lower="-1_0"'),),
        ("joint 'j2': <limit lower=\"-1_0\"> is no finite number; write one, in rad",),
    ),
    "limit that is empty": (
        ((LOWER, '<limit lower=""'),),
        ("joint 'j2': <limit lower=\"\"> is empty; write a number, in rad",),
    ),
    "no effort": (
        ((J2, J2.replace('effort="150" ', "")),),
        ("joint 'j2': <limit> has no effort; write it, in Nm",),
    ),
    "no limit": (
        ((J2, J2.replace('<limit lower="-2.0" upper="2.0" effort="150" velocity="2"/>', "")),),
        (
            "joint 'j2' is revolute and has no <limit>; write it, as "
            '<limit lower="-3" upper="3" effort="50" velocity="2"/>',
        ),
    ),
    "no parent": (
        (('<parent link="l3"/>', ""),),
        ("joint 'j4' has no parent; name it, as <parent link=\"link_1\"/>",),
    ),
    "parent of another name": (
        (('<parent link="l3"/>', '<parent link="L3"/>'),),
        ("joint 'j4' holds the link 'L3', which is not there (did you mean 'l3'?)",),
    ),
    "joint of another type": (
        ((J4, J4.replace("revolute", "revolve")),),
        ("joint 'j4' has the type 'revolve', which is no joint type (did you mean 'revolute'?)",),
    ),
    "joint without a type": (
        ((J4, J4.replace(' type="revolute"', "")),),
        ("joint 'j4' has no type; known: revolute, continuous, prismatic, fixed, floating, planar",),
    ),
    "two joints of one name": (
        (('joint name="j5"', 'joint name="j4"'),),
        ("2 joints have the name 'j4'; give each a name of its own",),
    ),
    "two links of one name": (
        ((L3, L3 + L3),),
        ("2 links have the name 'l3'; give each a name of its own",),
    ),
    "joint of the world's name": (
        (('joint name="j5"', 'joint name="universe"'),),
        ("joint 'universe' has the name of the world; give it another one",),
    ),
    "joint without a name": (
        (('joint name="j5"', "joint"),),
        ("the <joint> behind 'j4' has no name",),
    ),
    "mimic of nothing": (
        (('<mimic joint="f1"/>', '<mimic joint="f3"/>'),),
        ("joint 'f2' mimics 'f3', which is no joint (known: j1, j2, j3, j4, j5, j6, flange, f1, …)",),
    ),
    "mimic of what does not move": (
        (('<mimic joint="f1"/>', '<mimic joint="flange"/>'),),
        ("joint 'f2' mimics 'flange', which does not move; name a joint that does",),
    ),
    "mimic of itself": (
        (('<mimic joint="f1"/>', '<mimic joint="f2"/>'),),
        ("joint 'f2' mimics itself; name the joint that it follows",),
    ),
    "mimics in a ring": (
        (('upper="0.04" effort="30" velocity="0.2"/></joint>', 'upper="0.04" effort="30" velocity="0.2"/>'
          '<mimic joint="f2"/></joint>'),),
        ("joints 'f1' and 'f2' mimic each other in a ring; one must mimic none",),
    ),
    "mimic with a word": (
        (('<mimic joint="f1"/>', '<mimic joint="f1" multiplier="minus"/>'),),
        ("joint 'f2': <mimic multiplier=\"minus\"> is no number; write one",),
    ),
    "negative mass": (
        (('<mass value="3"/>', '<mass value="-3"/>'),),
        ("link 'l3': <mass value=\"-3\"> is less than 0",),
    ),
    "mass with a unit": (
        (('<mass value="3"/>', '<mass value="3000 g"/>'),),
        ("link 'l3': <mass value=\"3000 g\"> has a unit; write 3, in kg",),
    ),
    "origin with commas": (
        (('<origin xyz="0 0 0.4"/>', '<origin xyz="0, 0, 0.4"/>'),),
        ("joint 'j3': <origin xyz=\"0, 0, 0.4\"> has commas; write \"0 0 0.4\"",),
    ),
    "origin in millimetres": (
        (('<origin xyz="0 0 0.4"/>', '<origin xyz="0 0 400"/>'),),
        ("joint 'j3': <origin xyz=\"0 0 400\"> is in m: are these millimetres? Write \"0 0 0.4\"",),
    ),
    "angles in degrees": (
        (('<origin xyz="0 0 0.4"/>', '<origin xyz="0 0 0.4" rpy="0 0 90"/>'),),
        ("joint 'j3': <origin rpy=\"0 0 90\"> is in rad: are these degrees? Write \"0 0 1.5708\"",),
    ),
    "misspelt elements": (
        (('<origin xyz="0 0 0.4"/>', '<orgin xyz="0 0 0.4"/>'), (L3, L3.replace("inertial>", "Inertial>"))),
        (
            "link 'l3': <Inertial> is not read; write <inertial>",
            "joint 'j3': <orgin> is not read; write <origin>",
        ),
    ),
    "doubled elements": (
        (
            ('<origin xyz="0 0 0.4"/>', '<origin xyz="0 0 0.4"/><origin/>'),
            (L3, L3.replace("</inertial>", "</inertial><inertial/>")),
        ),
        ("link 'l3' has 2 <inertial>; keep one", "joint 'j3' has 2 <origin>; keep one"),
    ),
    "xacro left over": (
        (('<origin xyz="0 0 0.4"/>', '<origin xyz="0 0 %{length}"/>'.replace("%", "$")),),
        ("joint 'j3': <origin xyz=\"0 0 ${length}\"> is a xacro expression; expand the file with `xacro`",),
    ),
    "a ring of links": (
        (('<child link="l3"/>', '<child link="l1"/>'), ('<parent link="base"/><child link="l1"/>',
          '<parent link="base"/><child link="l3"/>')),
        ("links 'l2' and 'l1' hang on each other in a ring; one must be the base",),
    ),
    "two bases": (
        (("</robot>", '<link name="table"/></robot>'),),
        ("one link must be the base of all others, not 2: 'base' and 'table'; join them by fixed joints",),
    ),
    "a link on two joints": (
        ((J2, J2 + '<joint name="bar" type="fixed"><parent link="l1"/><child link="l3"/></joint>'),),
        ("link 'l3' hangs on two joints, 'bar' and 'j3'; remove one, or name another child",),
    ),
    "several at once": (
        ((LOWER, '<limit lower="-2,0"'), ('<mass value="3"/>', '<mass value="heavy"/>')),
        (
            "link 'l3': <mass value=\"heavy\"> is no number; write one, in kg",
            "joint 'j2': <limit lower=\"-2,0\"> has a decimal comma; write -2",
        ),
    ),
    "an entity": (
        (("<robot", '<!DOCTYPE robot [<!ENTITY reach "0.4">]><robot'),),
        ("entities are not read, as <!ENTITY reach>; `xmllint --noent FILE` writes a file without them",),
    ),
    "another element outside": (
        (("<robot", "<model"), ("</robot", "</model")),
        ("the outermost element is <model>, not <robot>",),
    ),
    "cut off": (
        (("</robot>", ""),),
        ("not readable as XML: no element found: line 25, column 0",),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_told_by_new_and_by_check(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    edits, told = FAULTS[name]
    urdf, file = tmp_path / "mini.urdf", tmp_path / "mini.yaml"
    urdf.write_text(mini(*edits), encoding="utf-8")
    with pytest.raises(UrdfError) as caught:
        parsed_urdf(urdf)
    assert caught.value.faults == told
    assert answer(["robot", "new", str(urdf), "-o", str(tmp_path / "new.yaml")]) == 2
    if "xacro" not in name:
        between = f"\n{' ' * 11}"
        assert capsys.readouterr().err == (
            f"{urdf}: no robot file can be made of it\n"
            f"  found    a file that cannot be used as a URDF: {between.join(told)}\n"
            "  missing  an XML file <robot> with <link> and <joint> elements that form one tree\n"
            "  helps    mend a copy of the file; `check_urdf FILE` of liburdfdom-tools describes "
            "the faults of a URDF\n"
        )
    assert not (tmp_path / "new.yaml").exists()
    file.write_text(ROBOT, encoding="utf-8")
    faults = check_files([file], CHECKS).faults
    assert [(f.code, f.mark.line, f.message) for f in faults] == [("P502", 3, f"{urdf}: {t}") for t in told]


@pytest.mark.parametrize(
    "edits",
    [
        (),
        (('<robot name="mini">', "<robot>"),),
        (('<robot name="mini">', '<robot name="mini" xmlns="http://example.org/urdf">'),),
        (('<robot name="mini">', '<robot name="mini"><!-- <!ENTITY --><sensor:ray/>'),),
        (('<?xml version="1.0"?>', '\n <?xml version="1.0" encoding="utf-8"?>\n<!DOCTYPE robot>'),),
        (('"flange"', '"hand"'),),
        (('"j4"', '"l4"'), ('"f1"', '"left"')),
        (('"l3"', '"the third link/ü"'), ('"j4"', '"j 4"')),
        (('"l3"', '"universe"'),),
        (('"l3"', '"picktree_tcp"'),),
        (('axis xyz="0 0 1"', 'axis xyz=" 0  0 2 "'),),
        (('velocity="2"', 'velocity=" 2 "'),),
        ((J2, J2.replace("</joint>", '<safety_controller soft_upper_limit="1.9"/></joint>')),),
        ((L3, f'{L3}<link name="tag"/><joint name="tag" type="fixed"><parent link="l1"/><child link="tag"/>'
          '<axis xyz="0 0 0"/><limit lower="1" upper="-1"/><safety_controller/></joint>'),),
    ],
    ids=["as it is", "no name", "namespace", "comment", "declaration", "joint as link", "joints as links",
         "other letters", "universe", "tcp", "long axis", "spaces", "safety", "fixed joint"],
)  # fmt: skip
def test_what_is_no_fault_gives_the_same_arm(edits: tuple[tuple[str, str], ...], tmp_path: Path) -> None:
    good = loaded(tmp_path, mini())
    other = loaded(tmp_path, mini(*edits), ROBOT.replace("flange_joint: flange", "flange_joint: hand")
                   if ('"flange"', '"hand"') in edits else renamed(edits))  # fmt: skip
    q = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    assert other.tcp(q).position == pytest.approx(good.tcp(q).position)
    assert other.gravity(q) == pytest.approx(good.gravity(q))
    assert other.hand_mass == pytest.approx(0.7)
    assert len(robot_geometry(other)) == 10
    assert other.flange(q).position == pytest.approx(good.flange(q).position)
    assert len(other.link_poses(q, 0.02)) - len(good.link_poses(q, 0.02)) == ("tag" in str(edits))


def renamed(edits: tuple[tuple[str, str], ...]) -> str:
    text = ROBOT.replace("  j4:", '  "j 4":') if ('"j4"', '"j 4"') in edits else ROBOT
    return text.replace("  j4:", "  l4:").replace("[f1,", "[left,") if ('"j4"', '"l4"') in edits else text


def loaded(folder: Path, urdf: str, robot: str = ROBOT) -> RobotModel:
    (folder / "mini.urdf").write_text(urdf, encoding="utf-8")
    (folder / "mini.yaml").write_text(robot, encoding="utf-8")
    return RobotModel(load_robot(str(folder / "mini.yaml")))


@pytest.mark.parametrize(
    ("encoding", "declared", "mark"),
    [
        ("utf-8", "", b"\xef\xbb\xbf"),
        ("utf-8", "utf-16", b"\xef\xbb\xbf"),
        ("utf-16-le", "utf-16", b"\xff\xfe"),
        ("utf-16-be", "utf-16", b"\xfe\xff"),
        ("utf-16-le", "utf-16", b""),
        ("utf-32-be", "utf-32", b"\0\0\xfe\xff"),
        ("iso-8859-1", "ISO-8859-1", b""),
        ("shift_jis", "Shift_JIS", b""),
        ("gb2312", "GB2312", b""),
        ("koi8-r", "KOI8-R", b""),
    ],
)
def test_a_urdf_is_read_in_other_encodings(encoding: str, declared: str, mark: bytes, tmp_path: Path) -> None:
    letters = {"iso-8859-1": "Käfer", "koi8-r": "рука", "utf-8": "ü"}.get(encoding, "腕")
    says = f' encoding="{declared}"' if declared else ""
    text = mini(('version="1.0"', f'version="1.0"{says}'), ('"l3"', f'"{letters}"'))
    (tmp_path / "mini.urdf").write_bytes(mark + text.encode(encoding))
    names = [each.get("name") for each in parsed_urdf(tmp_path / "mini.urdf").findall("link")]
    assert letters in names


@pytest.mark.parametrize(
    ("raw", "told"),
    [
        (mini().replace("mini", "Käfer").encode("iso-8859-1"),
         "the file is not UTF-8, for lack of encoding=… in its first line (line 2); save it as UTF-8"),
        (b'<?xml version="1.0" encoding="ebcdic-9"?><robot/>',
         "the encoding 'ebcdic-9' is not known; save the file as UTF-8"),
        (b'<?xml version="1.0" encoding="hex"?><robot/>',
         "the encoding 'hex' is not known; save the file as UTF-8"),
        (b"\xff\xfe<\0r", "the file is not UTF-16-LE by its byte order mark (line 1); save it as UTF-8"),
        (b"", "not readable as XML: no element found: line 1, column 0"),
        (b"<a>" * 200 + b"</a>" * 200, "elements are more than 100 levels deep in each other"),
        (b'<!DOCTYPE robot SYSTEM "robot.dtd"><robot>&arm;</robot>', "the entity &arm; is not defined"),
        (b"<robot/>" + b" " * 5_000_000, "the file is larger than 5 MB"),
    ],
    ids=["no encoding", "unknown", "no text", "cut off", "empty", "deep", "outer entity", "huge"],
)  # fmt: skip
def test_what_is_no_text_is_refused(raw: bytes, told: str, tmp_path: Path) -> None:
    (tmp_path / "mini.urdf").write_bytes(raw)
    with pytest.raises(UrdfError) as caught:
        parsed_urdf(tmp_path / "mini.urdf")
    assert caught.value.faults == (told,)


def test_many_faults_are_counted(tmp_path: Path) -> None:
    links = "".join(f'<link name="a{n}"><inertial/></link>' for n in range(30))
    (tmp_path / "mini.urdf").write_text(f"<robot>{links}</robot>")
    with pytest.raises(UrdfError) as caught:
        parsed_urdf(tmp_path / "mini.urdf")
    assert (len(caught.value.faults), caught.value.faults[-1]) == (20, "11 more faults")


def test_a_mimic_inside_of_the_arm_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf, file = tmp_path / "mini.urdf", tmp_path / "mini.yaml"
    urdf.write_text(mini((J4, J4.replace("</joint>", '<mimic joint="j1"/></joint>'))), encoding="utf-8")
    file.write_text(ROBOT, encoding="utf-8")
    assert answer(["robot", "new", str(urdf), "-o", str(tmp_path / "new.yaml")]) == 2
    assert capsys.readouterr().err == (
        f"{urdf}: no robot file can be made of it\n"
        "  found    an arm of 5 joints that move on their own, and in it j4 mimics j1\n"
        "  missing  an arm without <mimic>: each of its joints has a motor of its own\n"
        "  helps    remove <mimic> from j4 if a motor turns it; picktree cannot plan for a parallelogram\n"
    )
    (fault,) = check_files([file], CHECKS).faults
    assert (fault.code, fault.mark.line, fault.message, fault.hint) == (
        "P505",
        8,
        "'j4' is inside of the arm and mimics 'j1'",
        "remove <mimic> in a copy of the URDF if a motor of its own moves it",
    )
