"""Page of the tables of an exported log, made from their declarations.

python docs/tables_page.py > docs/reference-tables.md
"""

from __future__ import annotations

from collections.abc import Iterator

from picktree.analysis.export.run_tables import TABLES

HEAD = """\
# Tables of an exported log

All tables that `picktree export` writes, with their columns and units. How to export and read them: [viewers.md](viewers.md#tables).

```sh
picktree export last --to csv -o tables
```

| table | a row is |
|---|---|
"""  # noqa: E501 - a link may not be broken


def lines() -> Iterator[str]:
    yield from (f"| `{table.name}` | {table.meaning} |" for table in TABLES)
    for table in TABLES:
        yield from ("", f"## {table.name}", "", "| column | holds |", "|---|---|")
        for column in table.columns:
            unit = f" ({column.unit})" if column.unit else ""
            yield f"| `{column.name}`{unit} | {column.meaning} |"


if __name__ == "__main__":
    print(HEAD, end="")
    print("\n".join(lines()))
