"""Retreat: out of contact, away from obstacles, and home."""
