"""What several panels of a report share: packing, motions, ticks, texts."""
