"""Applications: command line, Python library, studio, batches, commissioning of a cell."""
