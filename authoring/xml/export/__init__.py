"""Export of missions to BehaviorTree.CPP's XML."""
