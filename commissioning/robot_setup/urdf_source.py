"""URDF from the command line: found, checked and read."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from ...errors import PicktreeError
from ...files.shipped_files import is_file
from ...files.yaml.file_text import Unreadable, read_bytes
from ...robots.gripper_mounting import NamedUrdf
from ...robots.urdf_tree import MAX_BYTES, UrdfError, UrdfTree, package_folder, read_skeleton


class UnsuitableUrdf(PicktreeError):
    """Error for a URDF from which no robot file can be made: what was found, what is missing, and what would
    help."""

    def __init__(self, urdf: str, found: str, missing: str, helps: str) -> None:
        self.found, self.missing, self.helps = found, missing, helps
        super().__init__(
            f"{urdf}: no robot file can be made of it\n  found    {found}\n"
            f"  missing  {missing}\n  helps    {helps}"
        )


_TEMPLATE = re.compile(rb"<xacro:\w|\$\{|\$\((?:arg|find|optenv|env|eval) ")


@dataclass(frozen=True, slots=True)
class UrdfSource:
    """URDF as named on the command line, found and read."""

    text: str
    """Name as given: a path, or `package:path`."""
    urdf: NamedUrdf
    skeleton: UrdfTree


def find_source(text: str) -> UrdfSource:
    """Find and read a URDF. Raises PicktreeError when there is no such file, UnsuitableUrdf when it is no
    URDF."""
    named = _named(text)
    refuse_template(text, named.path)
    try:
        return UrdfSource(text, named, read_skeleton(named.path))
    except UrdfError as error:
        raise UnsuitableUrdf(
            text,
            f"a file that cannot be read as a URDF: {error}",
            "an XML file <robot name=…> with <link> and <joint> elements that form one tree",
            "`check_urdf FILE` of liburdfdom-tools tells more about a URDF",
        ) from None


def refuse_template(text: str, path: Path) -> None:
    """Raise UnsuitableUrdf when the file is a xacro template, with the command that expands it."""
    try:
        raw = read_bytes(path, MAX_BYTES)
    except Unreadable as error:
        raise PicktreeError(f"{text}: {error}") from None
    if path.suffix == ".xacro" or _TEMPLATE.search(_without_comments(raw)):
        target = f"{path.name.removesuffix('.xacro').removesuffix('.urdf')}.urdf"
        raise UnsuitableUrdf(
            text,
            "a xacro template, from which a URDF is made",
            "the URDF itself",
            f"`pip install xacro`, then `xacro {path} > {target}`, and take {target}",
        )


def _without_comments(raw: bytes) -> bytes:
    return re.sub(rb"<!--.*?-->", b"", raw, flags=re.DOTALL)


def _named(text: str) -> NamedUrdf:
    package, colon, inside = text.partition(":")
    if colon and not is_file(Path(text)):
        folder = package_folder(package)
        if folder is None:
            raise PicktreeError(
                f"{text}: there is no installed package {package!r}; write a path, or package:path inside an "
                "installed Python package"
            )
        path = folder / inside
        if not path.resolve().is_relative_to(folder.resolve()):
            raise PicktreeError(f"{text}: that is outside of the package {package!r}")
        if not is_file(path):
            raise PicktreeError(f"{text}: there is no file {path}")
        return NamedUrdf(path, package, folder)
    path = Path(text)
    if not is_file(path):
        raise PicktreeError(f"there is no file {text}")
    return NamedUrdf(path)
