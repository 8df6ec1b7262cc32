"""Write: missions as text and picture, their faults, rehearsals and scenes."""
