"""A run as it goes: its messages over a WebSocket, at the pace of a watch."""
