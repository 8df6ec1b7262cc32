"""The parts of BehaviorTree.CPP's XML."""
