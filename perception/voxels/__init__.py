"""Space that nothing known explains, as voxels."""
