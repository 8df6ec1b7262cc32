"""The one root of all exceptions that mean "the set-up is wrong" (an expected failure is a `Failure`)."""


class PicktreeError(Exception):
    """Bad input or a broken set-up. The text is for the user: where, what, and what would be right."""
