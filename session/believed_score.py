"""Score of a run without ground truth: the items of the belief at the places where the robot believes
them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from picktree.world import BeliefObject, FormCount, ItemCount
from picktree.world.scene import SceneDescription, destinations


def believed_count(objects: Iterable[BeliefObject], scene: SceneDescription) -> ItemCount:
    """Return the counts of the items that the robot knows; an item that it never saw is not among them.

    Verdicts are those of the scorer: an item in a bin or hole counts there, any other one is left.
    """
    rule = destinations.destination_rule(scene.destinations)
    totes = {each.id for each in scene.bins if each.is_tote}
    containers = {str(each.id) for each in scene.bins} - totes
    containers |= {str(hole.id) for fixture in scene.fixtures for hole in fixture.holes}
    verdicts: Counter[str] = Counter()
    forms: dict[str, Counter[str]] = {}
    for each in objects:
        if each.role != "item":
            continue
        destination = rule(each)
        verdict = "left"
        if destination is None:
            verdict = "misplaced" if each.place in containers else "no destination"
        elif each.place in containers:
            verdict = "sorted" if destinations.is_at(each.place, destination) else "misplaced"
        verdicts[verdict] += 1
        forms.setdefault(each.form, Counter())[verdict] += 1
    by_form = {
        form: FormCount(count.total() - count["no destination"], count["sorted"])
        for form, count in forms.items()
    }
    return ItemCount(
        verdicts.total() - verdicts["no destination"],
        verdicts["sorted"],
        verdicts["misplaced"],
        verdicts["left"],
        by_form,
        verdicts["no destination"],
    )
