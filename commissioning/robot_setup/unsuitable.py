"""Why no robot file can be made of a URDF."""

from __future__ import annotations

from ...errors import PicktreeError


class Unsuitable(PicktreeError):
    """What was found, what is missing, and what would help: a sentence each, told together."""

    def __init__(self, urdf: str, found: str, missing: str, helps: str) -> None:
        self.found, self.missing, self.helps = found, missing, helps
        super().__init__(
            f"{urdf}: no robot file can be made of it\n  found    {found}\n"
            f"  missing  {missing}\n  helps    {helps}"
        )
