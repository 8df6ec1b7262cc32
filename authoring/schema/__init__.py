"""JSON Schema (draft-07) of the files that people write, made from the declarations that check them.

Editors complete, explain and underline by it. Its rule: what the schema refuses, the checker refuses too; the
checker sees more. Where several forms are allowed it uses keywords that each concern one type of value only,
rather than alternatives, so that a language server can say which of them is meant and what is wrong with it.
"""
