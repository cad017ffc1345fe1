"""What is raised and warned of: each text is one sentence for the user."""


class InputError(ValueError):
    """Bad input, said in one sentence: what was given, why it cannot be, what to do.

    The command line prints the sentence and exits with code 2; from Python it is a `ValueError`.
    """


class FpjaxWarning(UserWarning):
    """A result is given, but the user should know something about it (the sentence says what)."""


class DivergedError(ArithmeticError):
    """A run that left the range of finite numbers, where `throw` asked for it: a result, not a wrong input."""
