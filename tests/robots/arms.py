"""A small arm of six joints with two sliding fingers: a URDF that is right, to be spoilt in one place."""

from __future__ import annotations

JOINTS = {
    # name: parent, child, height over the parent, axis, range, effort
    "j1": ("base", "l1", 0.12, "0 0 1", 2.9, 150),
    "j2": ("l1", "l2", 0.18, "0 1 0", 2.0, 150),
    "j3": ("l2", "l3", 0.40, "0 1 0", 2.6, 80),
    "j4": ("l3", "l4", 0.30, "0 0 1", 2.9, 30),
    "j5": ("l4", "l5", 0.10, "0 1 0", 2.2, 30),
    "j6": ("l5", "l6", 0.065, "0 0 1", 2.9, 30),
}
LINKS = {
    # name: mass, centre of its box, size of its box
    "base": (4, "0 0 0.06", "0.14 0.14 0.12"),
    "l1": (4, "0 0 0.09", "0.12 0.12 0.18"),
    "l2": (4, "0 0.09 0.2", "0.08 0.06 0.46"),
    "l3": (3, "0 0 0.15", "0.08 0.06 0.36"),
    "l4": (1.2, "0 0 0.05", "0.07 0.07 0.12"),
    "l5": (1.0, "0 0 0.02", "0.06 0.06 0.09"),
    "l6": (0.5, "0 0 0.015", "0.06 0.06 0.03"),
    "hand": (0.6, "0 0 0.03", "0.05 0.2 0.06"),
    "left": (0.05, "0 0.006 0.025", "0.02 0.012 0.05"),
    "right": (0.05, "0 -0.006 0.025", "0.02 0.012 0.05"),
}
FINGER = '<limit lower="0" upper="0.04" effort="30" velocity="0.2"/>'
FINGERS = f"""\
<joint name="flange" type="fixed"><parent link="l6"/><child link="hand"/><origin xyz="0 0 0.03"/></joint>
<joint name="f1" type="prismatic"><parent link="hand"/><child link="left"/><origin xyz="0 0 0.06"/>
  <axis xyz="0 1 0"/>{FINGER}</joint>
<joint name="f2" type="prismatic"><parent link="hand"/><child link="right"/><origin xyz="0 0 0.06"/>
  <axis xyz="0 -1 0"/>{FINGER}<mimic joint="f1"/></joint>
"""


def link(name: str, more: str = "") -> str:
    """Return a link of the arm as an element, with `more` in it."""
    mass, at, size = LINKS[name]
    box = f'<origin xyz="{at}"/><geometry><box size="{size}"/></geometry>'
    moment = 0.002 * mass
    return (
        f'<link name="{name}"><inertial><origin xyz="{at}"/><mass value="{mass}"/><inertia ixx="{moment}" '
        f'ixy="0" ixz="0" iyy="{moment}" iyz="0" izz="{moment}"/></inertial><visual>{box}</visual>'
        f"<collision>{box}</collision>{more}</link>"
    )


def joint(name: str) -> str:
    """Return a joint of the arm as an element."""
    parent, child, height, axis, most, effort = JOINTS[name]
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 {height}"/><axis xyz="{axis}"/>'
        f'<limit lower="{-most}" upper="{most}" effort="{effort}" velocity="2"/></joint>'
    )


def mini(*edits: tuple[str, str]) -> str:
    """Return the arm's URDF after edits: in each, the first text becomes the second. Each text is in it."""
    lines = [*map(link, LINKS), *map(joint, JOINTS), FINGERS]
    text = '<?xml version="1.0"?>\n<robot name="mini">\n' + "\n".join(lines) + "</robot>\n"
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    return text


ROBOT = """\
picktree: 1
kind: robot
urdf: mini.urdf
joints:
  j1: {lower: -2.8, upper: 2.8, velocity: 2, acceleration: 6, torque: 150}
  j2: {lower: -1.9, upper: 1.9, velocity: 2, acceleration: 6, torque: 150}
  j3: {lower: -2.5, upper: 2.5, velocity: 2, acceleration: 6, torque: 80}
  j4: {lower: -2.8, upper: 2.8, velocity: 2, acceleration: 6, torque: 30}
  j5: {lower: -2.1, upper: 2.1, velocity: 2, acceleration: 6, torque: 30}
  j6: {lower: -2.8, upper: 2.8, velocity: 2, acceleration: 6, torque: 30}
poses: {home: [0, -0.6, 1.9, 0, 1.8, 0]}
tcp: {link: hand, at: [0, 0, 0.1]}
flange_joint: flange
gripper:
  joints: [f1, f2]
  links: [left, right]
  max_width: 80 mm
  max_force: 30 N
  speed: 100 mm/s
  gear: -1
  tip: 10 mm
  palm: 40 mm
  pads:
    - {box: [20 mm, 12 mm, 50 mm], at: [0, 6 mm, 25 mm]}
    - {box: [20 mm, 12 mm, 50 mm], at: [0, -6 mm, 25 mm]}
  hand: [{box: [50 mm, 200 mm, 60 mm], at: [0, 0, -70 mm]}]
  finger: {box: [20 mm, 12 mm, 50 mm], at: [0, 6 mm, -15 mm]}
disabled_pairs: []
"""
"""Robot file of the arm, which is written beside its URDF as `mini.urdf`."""

HINGED = """\
<link name="left_knuckle"/><link name="right_knuckle"/><link name="tool"/>
<joint name="flange" type="fixed"><parent link="l6"/><child link="hand"/><origin xyz="0 0 0.03"/></joint>
<joint name="tool" type="fixed"><parent link="hand"/><child link="tool"/><origin xyz="0 0 0.155"/></joint>
<joint name="k1" type="revolute"><parent link="hand"/><child link="left_knuckle"/>
  <origin xyz="0 0.02 0.06"/><axis xyz="-1 0 0"/>
  <limit lower="0" upper="0.8" effort="2" velocity="2"/></joint>
<joint name="k2" type="revolute"><parent link="hand"/><child link="right_knuckle"/>
  <origin xyz="0 -0.02 0.06"/><axis xyz="1 0 0"/><limit lower="0" upper="0.8" effort="2" velocity="2"/>
  <mimic joint="k1"/></joint>
<joint name="t1" type="revolute"><parent link="left_knuckle"/><child link="left"/>
  <origin xyz="0 0 0.05"/><axis xyz="-1 0 0"/><limit lower="-0.8" upper="0" effort="2" velocity="2"/>
  <mimic joint="k1" multiplier="-1"/></joint>
<joint name="t2" type="revolute"><parent link="right_knuckle"/><child link="right"/>
  <origin xyz="0 0 0.05"/><axis xyz="1 0 0"/><limit lower="-0.8" upper="0" effort="2" velocity="2"/>
  <mimic joint="k2" multiplier="-1"/></joint>
"""
"""Fingers on hinges that stay parallel, instead of FINGERS. The frame `tool` is 5 mm behind the tips
of closed fingers; open fingers reach 15 mm less far."""
HINGED_HAND = (
    (FINGERS, HINGED),
    ('"0 0.006 0.025"', '"0 -0.014 0.025"'),
    ('"0 -0.006 0.025"', '"0 0.014 0.025"'),
)
BAR = """\
<link name="bar"><inertial><mass value="0.2"/><inertia ixx="0.001" iyy="0.001" izz="0.001"/></inertial>
<collision><origin xyz="0 0 0.05"/><geometry><box size="0.03 0.16 0.02"/></geometry></collision></link>
<link name="prop"><inertial><mass value="0.01"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5"/></inertial>
<collision><geometry><box size="0.02 0.04 0.004"/></geometry></collision></link>
<joint name="flange" type="fixed"><parent link="l6"/><child link="bar"/><origin xyz="0 0 0.03"/></joint>
<joint name="motor" type="continuous"><parent link="l6"/><child link="prop"/><origin xyz="0 0 0.11"/>
  <axis xyz="0 0 1"/><limit effort="1" velocity="2"/></joint>
<joint name="slide" type="fixed"><parent link="bar"/><child link="hand"/><origin xyz="0 0 0.07"/></joint>
<joint name="f1" type="prismatic"><parent link="hand"/><child link="left"/>
  <axis xyz="0 1 0"/><limit lower="0.015" upper="0.037" effort="1" velocity="1"/></joint>
<joint name="f2" type="prismatic"><parent link="hand"/><child link="right"/>
  <axis xyz="0 1 0"/><limit lower="-0.037" upper="-0.015" effort="1" velocity="1"/>
  <mimic joint="f1" multiplier="-1"/></joint>
"""
"""Fingers on a bar that is fixed to the arm, instead of FINGERS. They do not meet, and the link that carries
them has no body. A wheel that a motor turns is between them, and touches shut ones."""
BAR_HAND = (
    (link("hand"), '<link name="hand"/>'),
    (FINGERS, BAR),
    ('"0 0.006 0.025"', '"0 -0.003 0.025"'),
    ('"0 -0.006 0.025"', '"0 0.003 0.025"'),
)
