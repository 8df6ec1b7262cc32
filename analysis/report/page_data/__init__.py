"""Data for several panels of a report: packing, motions, ticks, texts."""
