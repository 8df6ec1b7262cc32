"""Authoring tools for missions: checks, rehearsal, drawings, schemas, reference, XML."""
