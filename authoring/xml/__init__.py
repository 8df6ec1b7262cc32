"""Export and import of missions as BehaviorTree.CPP 4 XML."""
