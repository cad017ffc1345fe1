"""Exceptions and warnings; the text of each is one sentence for the user."""

LONGEST = 600  # longest message [characters]: users do not read more
LONGEST_WORD = 255  # longest word of a long message [characters]: the longest file name of common file systems
_CUT = "..."


def readable(text: str) -> str:
    """A message on one line and of limited length; very long words, which come from users' files, are shortened.

    Args:
        text: the message.
    """
    line = " ".join(text.split("\n")) if "\n" in text else text
    if len(line) <= LONGEST:
        return line
    # Long words are shortened further and further, before the message itself is cut: the sentence around them matters.
    words = line.split(" ")
    most = LONGEST_WORD
    while most > 40 and sum(map(len, words)) + len(words) - 1 > LONGEST:
        words = [_shortened(word, most) for word in words]
        most //= 2
    return _shortened(" ".join(words), LONGEST)


def _shortened(text: str, most: int) -> str:
    if len(text) <= most:
        return text
    tail = (most - len(_CUT)) // 3
    return text[: most - len(_CUT) - tail] + _CUT + text[-tail:]


class InputError(ValueError):
    """Bad input; the message says in one sentence what it must be, what was given, and what to do.

    The command line prints the sentence and exits with code 2; from Python it is a `ValueError`.
    """

    def __init__(self, sentence: str = "") -> None:
        super().__init__(readable(sentence))


class FpjaxWarning(UserWarning):
    """A warning about a result that is given; the message says in one sentence what the user should know."""

    def __init__(self, sentence: str = "") -> None:
        super().__init__(readable(sentence))


class DivergedError(ArithmeticError):
    """A run that diverged, raised only where `throw` asks for it: divergence is a result, not a wrong input."""
