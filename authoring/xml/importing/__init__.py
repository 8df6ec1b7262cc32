"""Import of missions from BehaviorTree.CPP's XML."""
