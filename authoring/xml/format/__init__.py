"""Parts of BehaviorTree.CPP's XML."""
