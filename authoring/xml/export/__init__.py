"""From missions to BehaviorTree.CPP's XML."""
