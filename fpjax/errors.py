"""The one exception that means "what you gave cannot be": its text is a sentence for the user."""


class InputError(ValueError):
    """Bad input, said in one sentence: what was given, why it cannot be, what to do.

    The command line prints the sentence and exits with code 2; from Python it is a `ValueError`.
    """


class FpjaxWarning(UserWarning):
    """A result is given, but the user should know something about it (the sentence says what)."""
