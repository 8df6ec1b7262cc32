"""Tools on the language: checks, rehearsal, drawing, schemas, the reference, XML."""
