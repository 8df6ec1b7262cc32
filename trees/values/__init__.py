"""Values of the language: types, references, reports."""
