"""Help of a command with many options, in groups."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from typer.core import TyperCommand

HelpGroups: TypeAlias = Mapping[str, Sequence[str]]
"""Parameters of a command by the heading under which its help has them."""


def grouped_command(groups: HelpGroups) -> type[TyperCommand]:
    """Return the class of a command whose help has its options in these groups; the others come last."""

    class GroupedCommand(TyperCommand):
        # typer has the types of its parser to itself, hence Any.
        def format_options(self, ctx: Any, formatter: Any) -> None:
            headings = {name: heading for heading, names in groups.items() for name in names}
            rows: dict[str, list[tuple[str, str]]] = {"Arguments": [], **{heading: [] for heading in groups}}
            for parameter in self.get_params(ctx):
                row = parameter.get_help_record(ctx)
                argument = parameter.param_type_name == "argument"
                heading = "Arguments" if argument else headings.get(str(parameter.name), "Other options")
                if row is not None:
                    rows.setdefault(heading, []).append(row)
            for heading, records in rows.items():
                if records:
                    with formatter.section(heading):
                        formatter.write_dl(records)

    return GroupedCommand
