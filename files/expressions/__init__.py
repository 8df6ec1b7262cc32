"""The expression language: tokens, parser, types, evaluation."""
