"""Places for the comments behind the last part of a list, a tree or the file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from .element import Element, LooseComment


def with_loose_comments(
    trees: tuple[Element, ...], comments: Iterable[LooseComment]
) -> tuple[tuple[Element, ...], tuple[str, ...]]:
    """Return the trees with the comments as far as they belong to one, and those below all trees.

    A comment belongs to the innermost element before it that is indented less.
    """
    done, below = list(trees), list[str]()
    for comment in comments:
        before = [index for index, tree in enumerate(done) if 0 < tree.mark.line < comment.line]
        home = max(before, key=lambda index: done[index].mark.line, default=None)
        placed = _placed(done[home], comment) if home is not None and comment.indent else None
        if home is None or placed is None:
            below.append(comment.text)
        else:
            done[home] = placed
    return tuple(done), tuple(below)


def _placed(element: Element, comment: LooseComment) -> Element | None:
    """Return the element with the comment in it, or in one below it; None when it stands outside."""
    before = [index for index, child in enumerate(element.children) if 0 < child.mark.line < comment.line]
    if not before:
        return None
    last = before[-1]
    child = element.children[last]
    inner = _placed(child, comment)
    if inner is not None:
        return replace(element, children=(*element.children[:last], inner, *element.children[last + 1 :]))
    if comment.indent + 1 <= element.mark.column:
        return None
    if last + 1 < len(element.children):
        after = element.children[last + 1]
        after = replace(after, comments=(comment.text, *after.comments))
        return replace(
            element, children=(*element.children[: last + 1], after, *element.children[last + 2 :])
        )
    return replace(element, end_comments=(*element.end_comments, comment.text))
