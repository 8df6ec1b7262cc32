"""Files that a URDF names: meshes in ROS packages, Python packages and folders."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Mapping
from functools import lru_cache
from importlib.util import find_spec
from itertools import chain
from pathlib import Path

from ...files.shipped_files import is_file

PACKAGE = "package://"
SHARED_DATA = Path("cmeel.prefix", "share")
"""Where packages that cmeel builds keep their data, beside the Python packages."""


def package_folder(package: str) -> Path | None:
    """Return the folder of an installed Python package, or of the data of a package that cmeel built.

    None: there is no such package. It is located, not imported: an import may run anything.
    """
    return _package_folder(package, tuple(sys.path))


@lru_cache(maxsize=64)
def _package_folder(package: str, path: tuple[str, ...]) -> Path | None:
    """Return the folder of a package; each mesh of a URDF names it again. `path`: where Python searches."""
    try:
        spec = find_spec(package) if package.isidentifier() else None
    except ValueError:
        spec = None
    roots = list(spec.submodule_search_locations or ()) if spec else []
    if not roots and package and "/" not in package and package not in (".", ".."):
        shared = (Path(folder) / SHARED_DATA / package for folder in path)
        roots = [str(folder) for folder in shared if folder.is_dir()]
    return Path(roots[0]) if roots else None


def mesh_file(urdf: Path, reference: str) -> Path | None:
    """Return the file of a mesh that a URDF names; None when there is none.

    A plain path counts from the URDF's folder. `package://name/path` is searched in the installed Python
    package of that name, then from the URDF's folder upwards. There it may be `path` or `name/path`, as in
    ROS packages on a disk. Then come the packages of ROS_PACKAGE_PATH and of AMENT_PREFIX_PATH.
    """
    plain = Path(reference.removeprefix(PACKAGE).removeprefix("file://"))
    if not reference.startswith(PACKAGE):
        file = urdf.parent / plain
        return file if is_file(file) else None
    if not plain.parts:
        return None
    name, inside = plain.parts[0], Path(*plain.parts[1:])
    package = package_folder(name)
    if package is not None and is_file(package / inside):
        return package / inside
    for folder in chain((urdf.parent,), _parents(urdf)):
        for tail in (plain, inside):
            if is_file(folder / tail):
                return folder / tail
    return next((folder / inside for folder in _ros_folders(name) if is_file(folder / inside)), None)


def _parents(file: Path) -> Iterator[Path]:
    """Yield the folders above the file that the path leads to."""
    yield from file.resolve().parents


ROS_PATH, AMENT_PATH = "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"
"""Variables of the environment that name folders of ROS packages, and prefixes of ROS 2 installations."""
MAX_ROS_DEPTH = 6
"""Greatest depth below a folder of ROS_PACKAGE_PATH at which packages are searched."""


def _ros_folders(package: str) -> Iterator[Path]:
    """Yield the folders of a ROS package by the environment, the most important first."""
    for folder in _listed_folders(ROS_PATH):
        if (found := _ros_packages(folder).get(package)) is not None:
            yield found
    for prefix in _listed_folders(AMENT_PATH):
        yield prefix / "share" / package


def _listed_folders(variable: str) -> Iterator[Path]:
    yield from (Path(part) for part in os.environ.get(variable, "").split(os.pathsep) if part)


@lru_cache(maxsize=16)
def _ros_packages(root: Path) -> Mapping[str, Path]:
    """Return the ROS packages at or below a folder by their names. Within a package none is searched."""
    found: dict[str, Path] = {}
    for folder, below, files in os.walk(root):
        here = Path(folder)
        if "package.xml" in files or "manifest.xml" in files:
            found.setdefault(_ros_name(here), here)
            below.clear()
        elif len(here.relative_to(root).parts) >= MAX_ROS_DEPTH or _IGNORED.intersection(files):
            below.clear()
        below[:] = sorted(name for name in below if not name.startswith("."))
    return found


_IGNORED = frozenset(("CATKIN_IGNORE", "COLCON_IGNORE", "AMENT_IGNORE"))
_NAME = re.compile(r"<name>\s*([^<\s]+)\s*</name>")


def _ros_name(folder: Path) -> str:
    """Return the name of the package in a folder: that of its package.xml, else that of the folder."""
    try:
        named = _NAME.search((folder / "package.xml").read_text(encoding="utf-8", errors="replace"))
    except OSError:
        named = None
    return folder.name if named is None else named[1]
