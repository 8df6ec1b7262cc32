"""The plans among the examples say what they seem to say."""

from pathlib import Path

from picktree.apps.batch import load_plan

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_the_plan_of_grip_forces_pairs_two_recipes_on_40_seeds() -> None:
    plan = load_plan(EXAMPLES / "plan_grip_force.yaml")
    assert [variant.label for variant in plan.variants()] == ["Grasp.force=1.5 N", "Grasp.force=30 N"]
    assert plan.seeds == tuple(range(40))
    assert (plan.name, plan.keep, plan.limit) == ("grip force", "failures", 600.0)


def test_every_plan_is_free_of_faults() -> None:
    plans = sorted(EXAMPLES.glob("plan_*.yaml"))
    assert plans
    for plan in plans:
        load_plan(plan)
