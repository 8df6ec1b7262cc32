"""JSON Schema (draft-07) of the files that people write, generated from the declarations that check them.

Editors use it for completion, documentation and error marks. The checker refuses everything that the schema
refuses, and more. Where several forms are allowed, each keyword concerns one type of value only, without
alternatives. A language server can then show which form is meant and what is wrong with it.
"""
