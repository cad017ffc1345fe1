"""What is raised and warned of: each text is one sentence for the user."""

LONGEST = 600  # characters of a message: what is longer is not read
LONGEST_WORD = 255  # characters: the longest name that file systems take
_CUT = "..."


def readable(text: str) -> str:
    """A message of one line and a length that is read: what users or files named without an end is cut in its middle.

    Args:
        text: the message.
    """
    line = " ".join(text.split("\n")) if "\n" in text else text
    if len(line) <= LONGEST:
        return line
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
    """Bad input, said in one sentence: what it must be, what was given, what to do.

    The command line prints the sentence and exits with code 2; from Python it is a `ValueError`.
    """

    def __init__(self, sentence: str = "") -> None:
        super().__init__(readable(sentence))


class FpjaxWarning(UserWarning):
    """A result is given, but the user should know something about it (the sentence says what)."""

    def __init__(self, sentence: str = "") -> None:
        super().__init__(readable(sentence))


class DivergedError(ArithmeticError):
    """A run that left the range of finite numbers, where `throw` asked for it: a result, not a wrong input."""
