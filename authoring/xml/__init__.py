"""Missions as BehaviorTree.CPP 4 XML, out and in."""
