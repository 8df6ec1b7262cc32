"""Behaviour-tree language of missions: node declarations, control nodes, loader, registry, runner."""
