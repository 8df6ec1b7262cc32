"""Search for the files that robot files and URDFs name: in a Python package, or beside the naming file."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from ..files.shipped_files import is_file

PACKAGE = "package://"


def package_folder(package: str) -> Path | None:
    """Return the folder of an installed Python package; None when there is no such package.

    Located, not imported: an import may run anything.
    """
    try:
        spec = find_spec(package) if package.isidentifier() else None
    except ValueError:
        spec = None
    roots = list(spec.submodule_search_locations or ()) if spec else []
    return Path(roots[0]) if roots else None


def mesh_file(urdf: Path, reference: str) -> Path | None:
    """Return the file of a mesh that a URDF names; None when there is none.

    A plain path counts from the URDF's folder. `package://name/path` is searched in the installed Python
    package of that name, then from the URDF's folder upwards. There it may be `path` or `name/path`, as in
    ROS packages on a disk.
    """
    plain = Path(reference.removeprefix(PACKAGE).removeprefix("file://"))
    if not reference.startswith(PACKAGE):
        file = urdf.parent / plain
        return file if is_file(file) else None
    if not plain.parts:
        return None
    package = package_folder(plain.parts[0])
    if package is not None and is_file(inside := package.joinpath(*plain.parts[1:])):
        return inside
    for folder in (urdf.parent, *urdf.resolve().parents):
        for tail in (plain, Path(*plain.parts[1:])):
            if is_file(folder / tail):
                return folder / tail
    return None
