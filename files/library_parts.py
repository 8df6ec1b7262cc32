"""Parts and versions of libraries. A part is imported without the packages around it.

`scipy.linalg.lapack.dposv` and `toppra.solverwrapper.cy_seidel_solverwrapper` are extension modules that need
numpy alone. Importing them the usual way also runs the `__init__` of every package above them: 0.5 s of CPU
in each process, for hundreds of modules that picktree does not use.
"""

from __future__ import annotations

import sys
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib import import_module, metadata
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any, Final

_NO_NAMES: Final[Mapping[str, Any]] = MappingProxyType({})


@cache
def library_part(module: str, public: str, *needed: str) -> Any:
    """Return the object named `public`, such as `scipy.linalg.lapack.dposv`, from `module`, which is imported
    alone.

    `needed`: other packages whose modules it imports. Where the library is arranged otherwise, the public
    name is imported as usual. Other imports of the library, before or after, get the same object.
    """
    place, _, name = public.rpartition(".")
    packages = module.split(".")[:-1]
    try:
        with bare_packages(*(".".join(packages[: n + 1]) for n in range(len(packages))), *needed):
            return getattr(import_module(module), name)
    except (ImportError, AttributeError):
        return getattr(import_module(place), name)


@cache
def library_version(distribution: str) -> str:
    """Return the version of an installed distribution; "unknown" when it is not installed."""
    try:
        text = metadata.distribution(distribution).read_text("METADATA") or ""
    except metadata.PackageNotFoundError:
        return "unknown"
    # The whole file, with its licences, takes a millisecond to parse.
    return next((line[9:].strip() for line in text.splitlines() if line.startswith("Version: ")), "unknown")


@contextmanager
def bare_packages(*names: str, **contents: Mapping[str, Any]) -> Generator[None]:
    """Let packages that are not loaded be empty in the block, so that a module in them loads alone.

    `names`: packages from the outermost on. `contents`: attributes of an otherwise empty package or module,
    by its name with underscores for dots. Modules that are loaded in the block stay loaded. The empty
    packages do not, and are imported as usual later on; they import from these modules, but have no
    attributes for them. Raises ImportError when the outermost one is not installed.
    """
    root = find_spec(names[0])
    if root is None or root.origin is None:
        raise ImportError(f"No module named {names[0]!r}", name=names[0])
    folder = Path(root.origin).parent
    added = [name for name in names if name not in sys.modules]
    for name in added:
        package = ModuleType(name)
        package.__path__ = [str(folder.joinpath(*name.split(".")[1:]))]
        vars(package).update(contents.get(name.replace(".", "_"), _NO_NAMES))
        sys.modules[name] = package
    try:
        yield
    finally:
        for name in added:
            del sys.modules[name]
