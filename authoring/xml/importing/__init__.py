"""From BehaviorTree.CPP's XML to missions."""
